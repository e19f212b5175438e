"""One training on several processes: who they are, and how they are started and led."""

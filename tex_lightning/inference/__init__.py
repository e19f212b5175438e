"""Running trained networks fast: the same weights and class scores, other arithmetic."""

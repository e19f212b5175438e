"""Run trained networks fast: the same weights and class scores by other arithmetic."""

"""Write trained networks as files for use without this package."""

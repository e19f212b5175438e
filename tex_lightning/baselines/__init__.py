"""Baselines: the other systems of the paper and MiniRocket, behind one interface."""

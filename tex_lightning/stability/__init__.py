"""Where classifiers fail: recordings perturbed by degrees, and what becomes of the votes."""

"""Where classifiers fail: recordings perturbed at increasing severity, and the votes on them."""

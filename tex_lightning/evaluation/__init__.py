"""What classifiers made of test samples, and what that says of them."""

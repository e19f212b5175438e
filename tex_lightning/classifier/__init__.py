"""The classifier: its card, its vote, what it calls unknown, the statistics of its embeddings."""

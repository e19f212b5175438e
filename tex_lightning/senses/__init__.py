"""Senses: how the files of one modality are decoded, their features and their network."""

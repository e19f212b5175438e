"""Training: one LightningModule per network on a short common base."""

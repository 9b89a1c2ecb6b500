"""Trained models that come with the package, and how one gets there."""

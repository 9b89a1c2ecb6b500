"""Metrics of a model on a dataset: samples with truth, predictions, baselines, reports."""

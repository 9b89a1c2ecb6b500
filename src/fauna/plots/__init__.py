"""Curves of training runs: ``python -m fauna.plots RUN [RUN ...] --out curves.png``."""

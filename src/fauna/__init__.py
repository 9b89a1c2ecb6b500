"""Articulated 3D animals learned from photographs."""

__version__ = "0.1.0"

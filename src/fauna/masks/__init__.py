"""Masks for photographs that come without one, and the animals in a mask."""

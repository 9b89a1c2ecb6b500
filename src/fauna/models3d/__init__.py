"""Rigged models from files, photographed in the zoo's surroundings."""

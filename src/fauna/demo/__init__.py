"""``fauna-demo``: a page on this computer that turns a photograph into a 3D animal."""

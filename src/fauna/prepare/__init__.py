"""``fauna-prepare``: from a pile of photographs to a training set (docs/prepare.md)."""

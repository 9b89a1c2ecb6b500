"""Procedural photographs of animals with truth: the default dataset, and a test bed for everything that needs ground truth."""

from fauna.zoo.zoo import HELD_OUT, SPECIES, Zoo, ZooSample, ZooTruth

__all__ = ["HELD_OUT", "SPECIES", "Zoo", "ZooSample", "ZooTruth"]

"""Every loss term of the paper, one name each: see ``objective.TERMS``."""

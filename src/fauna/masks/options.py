"""Numbers of the default segmenter; their home is ``conf/reconstruct.yaml``."""

from dataclasses import dataclass


@dataclass(frozen=True)
class SaliencyOptions:
    """How cells are rated.

    Attributes:
        centre_weight: of the prior that photographers point at their subject, relative to the features.
        centre_sigma: its width, picture widths.
        foreground_share: of the cells, those that stand out most, from which the foreground's features are learned.
        background_share: the same of those that stand out least.
        first_weight: of the first rating beside that by learned features.
    """

    centre_weight: float
    centre_sigma: float
    foreground_share: float
    background_share: float
    first_weight: float


@dataclass(frozen=True)
class GrabCutOptions:
    """How seeds become a mask.

    Attributes:
        side: longer side of the picture that is cut, pixels.
        animal_share: of the picture, what is taken for animal before colours are looked at.
        sure_animal: deviations above that threshold from which a pixel is certainly animal.
        sure_background: deviations below it from which a pixel is certainly background.
        iterations: of GrabCut.
        look_closer: a second look is taken at a square window of this many extents of the first mask; 0 takes none.
        closer_share: only if that window is smaller than this share of the picture.
        part_share: parts of a mask with less than this share of the best part's area are dropped.
        largest_share: a mask of more of the picture than this means that nothing was found.
    """

    side: int
    animal_share: float
    sure_animal: float
    sure_background: float
    iterations: int
    look_closer: float
    closer_share: float
    part_share: float
    largest_share: float

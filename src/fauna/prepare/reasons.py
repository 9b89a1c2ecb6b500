"""Why a picture is not used: every word that a manifest may say against one, and what it may note besides."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Reason:
    """A word of the vocabulary.

    Attributes:
        step: that says it.
        meaning: in words.
        can_be_overridden: whether ``keep`` in the list of overrides sets it aside.
    """

    step: str
    meaning: str
    can_be_overridden: bool = False


REASONS: dict[str, Reason] = {
    "annotation": Reason("scan", "the annotation cannot be used, its origin says why"),
    "refused": Reason("scan", "an archive holds it in a way that is not safe to unpack"),
    "missing": Reason("scan", "the file that an annotation names is not there"),
    "unreadable": Reason("scan", "no picture, a damaged one, or one that may not be read"),
    "too_large": Reason("scan", "the file or the picture exceeds what is read"),
    "too_small": Reason("scan", "the picture, or the animal in it, has too few pixels"),
    "size_differs": Reason("scan", "the picture has another size than its annotation says"),
    "same_frame": Reason("scan", "nearly the frame of the same video before it", True),
    "duplicate": Reason("scan", "the same file again"),
    "near_duplicate": Reason("scan", "nearly the same picture again", True),
    "bad_mask": Reason("mask", "the given mask is no picture, or none of this photograph"),
    "no_mask": Reason("mask", "no mask was given, and mask.segmenter=none"),
    "off_box": Reason("mask", "what the segmenter found in the annotated box is much smaller or elsewhere", True),
    "no_animal": Reason("mask", "the mask is empty, or nothing stands out from the background"),
    "more_animals": Reason("mask", "there are more animals than the limit, and this is one of the smaller ones", True),
    "small_animal": Reason("filter", "the animal has too few pixels in the photograph", True),
    "blurred": Reason("filter", "the animal is not sharp", True),
    "truncated": Reason("filter", "the animal goes on outside of the photograph", True),
    "occluded": Reason("filter", "the mask is in pieces: something stands before the animal", True),
    "low_fill": Reason("filter", "the animal covers too little of its crop", True),
    "high_fill": Reason("filter", "the animal covers so much of its crop that it is probably cut", True),
    "dropped": Reason("filter", "the list of overrides says so"),
    "few_photos": Reason("split", "its species has too few photographs", True),
}
"""Every reason by its word; manifests write ``step:reason``."""

NOTES: dict[str, str] = {
    "wrong_suffix": "the file is of another kind than its name says",
    "animated": "only the first picture of several was used",
    "reduced": "the photograph was reduced before anything else",
    "rotated": "turned as the camera noted",
    "colour_profile_ignored": "its colour profile could not be used",
    "alpha_ignored": "there is an alpha channel, but it separates nothing",
    "mask_resized": "the mask was brought to the photograph's size",
    "mask_from_saliency": "the mask was guessed from what stands out",
    "several_animals": "the photograph gave more than one animal",
    "mask_from_box": "the segmenter was shown the annotated box",
    "no_keypoint_annotated": "its list of keypoints has none that is annotated",
}
"""Every note by its word."""

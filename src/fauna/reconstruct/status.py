"""What can be said about a photograph: one status, and any number of flags."""

from typing import Literal

from fauna.errors import FaunaError

Status = Literal[
    "ok", "not_a_quadruped", "no_animal", "too_small", "too_large", "unreadable", "bad_mask", "failed", "exists"
]

MEANINGS: dict[Status, str] = {
    "ok": "reconstructed",
    "not_a_quadruped": "reconstructed, but what was found is probably no four-legged animal",
    "no_animal": "the mask is empty, or nothing stands out from the background",
    "too_small": "the photograph, or the animal in it, has too few pixels",
    "too_large": "the file or the photograph exceeds what is read",
    "unreadable": "no picture, a damaged one, or one that may not be read",
    "bad_mask": "the mask is no picture, or none of this photograph",
    "failed": "the model gave no usable mesh",
    "exists": "the output folder holds something else already",
}
"""Every status; ``ok`` and ``not_a_quadruped`` come with an animal."""

FLAGS = {
    "wrong_suffix": "the file is of another kind than its name says",
    "animated": "only the first picture of several was used",
    "reduced": "the photograph was reduced before anything else",
    "rotated": "turned as the camera noted",
    "colour_profile_ignored": "its colour profile could not be used",
    "alpha_ignored": "there is an alpha channel, but it separates nothing",
    "mask_resized": "the mask was brought to the photograph's size",
    "mask_from_saliency": "the mask was guessed from what stands out; it often misses legs or takes in the ground: look at preview.png",
    "several_animals": "the photograph gave more than one animal",
    "more_animals": "there were more animals than the limit; the smaller ones are left out",
    "cut_by_border": "the animal goes on outside the photograph",
    "ambiguous_viewpoint": "two or more viewpoints were about equally likely",
    "confidence_not_calibrated": "confidence was fitted to other weights than these: only its order means something",
    "refined": "bone angles and camera were fitted to the mask",
    "texture_finetuned": "the texture network was fitted to the photograph",
}
"""Every flag of a result."""


class Refused(FaunaError):
    """A photograph or animal that cannot be reconstructed.

    Attributes:
        status: why, in a word.
    """

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status: Status = status

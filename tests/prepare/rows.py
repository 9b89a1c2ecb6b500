"""Rows for tests."""

from dataclasses import replace
from typing import Any

from fauna.prepare.record import Record, photo_id, row_id


def row(source: str = "horse/1.jpg", *, instance: int = 0, **facts: Any) -> Record:
    """A row of a photograph as a source lists it, with further facts."""
    photo = photo_id("set", source, facts.get("frame"))
    species = source.split("/")[0]
    plain = Record(
        id=row_id(photo, instance), photo=photo, instance=instance, dataset="set", source=source, species=species, group=source
    )  # fmt: skip
    return replace(plain, **facts)


FULL = row(
    "horse/é%25.jpg", frame=3, origin="a.json/1", licence="CC0", provenance="me", annotated_size=(40, 30), box=(1.0, 2.0, 3.5, 4.0),
    given_mask="file:m.png", keypoints=((1.0, 2.0, 1.0), (0.0, 0.0, 0.0)), sha256="ab" * 32, phash="0" * 15 + "1", format="JPEG",
    width=40, height=30, orientation=6, exif='{"Make":"x"}', mask_source="given", window=(-1.0, 0.0, 33.0), sharpness=1.5, fill=0.25,
    truncation=0.0, occlusion=0.1, parts=2, rgb_sha256="cd" * 32, mask_sha256="ef" * 32, feat_sha256="01" * 32, duplicate_of="0" * 16,
    cluster="1" * 16, split="train", override="keep", status="rejected", reasons=("scan:unreadable", "filter:blurred"), notes=("rotated",),
)  # fmt: skip
"""A row with every field set."""

"""Several collections of photos as one."""

from collections.abc import Mapping

from fauna.data.fauna_folder import SPLITS, CategoryPhotos
from fauna.data.sources import PhotoCollection
from fauna.errors import FaunaError


class PhotoCollections(PhotoCollection):
    """Photos of several collections; species of one name become one species.

    A species of which one member brings its own validation or test photos keeps these and gets no others
    (:func:`fauna.data.splits.complete_splits`); otherwise photos are set aside from all members together.

    Args:
        members: collections by name.
    """

    def __init__(self, *, members: Mapping[str, PhotoCollection]) -> None:
        if not members:
            raise FaunaError(
                "data.source.members: expected at least one collection, got none; name some or use data=zoo"
            )
        self.members = dict(members)

    def categories(self) -> dict[str, CategoryPhotos]:
        """Photos per species.

        Raises:
            FaunaError: when two members use the same name for different photos.
        """
        merged: dict[str, CategoryPhotos] = {}
        names: set[str] = set()
        for member in self.members.values():
            for species, photos in member.categories().items():
                lists = {name: getattr(photos, name) for name in (*SPLITS, "back_views")}
                own = [photo.name for each in lists.values() for photo in each]
                if twice := names.intersection(own):
                    raise FaunaError(
                        f"data.source.members: expected photos with names of their own, got {sorted(twice)[0]} twice; name each dataset once"
                    )
                names.update(own)
                known = merged.get(species, CategoryPhotos(species, train=()))
                merged[species] = CategoryPhotos(
                    species, **{name: getattr(known, name) + each for name, each in lists.items()}
                )
        return dict(sorted(merged.items()))

    @property
    def identity(self) -> str:
        """Of all members."""
        return "+".join(member.identity for member in self.members.values())

    @property
    def keypoint_names(self) -> tuple[str, ...] | None:
        """Of the members when all agree, else ``None``."""
        found = {member.keypoint_names for member in self.members.values()}
        return found.pop() if len(found) == 1 else None

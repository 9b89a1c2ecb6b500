"""Annotations of photographs that EXIF turns: annotation tools of the COCO family look at pixels as they are stored, people at the upright picture."""

from collections.abc import Callable

from fauna.prepare.record import Box, Point

Size = tuple[int, int]
"""Width and height, pixels."""

_TURNS: dict[int, Callable[[float, float, int, int], tuple[float, float]]] = {
    2: lambda x, y, width, height: (width - x, y),
    3: lambda x, y, width, height: (width - x, height - y),
    4: lambda x, y, width, height: (x, height - y),
    5: lambda x, y, width, height: (y, x),
    6: lambda x, y, width, height: (height - y, x),
    7: lambda x, y, width, height: (height - y, width - x),
    8: lambda x, y, width, height: (y, width - x),
}
"""From stored to upright by EXIF orientation; 0 is the left or top edge, so that no half pixels appear."""


def stored_size(size: Size, orientation: int) -> Size:
    """Size of the stored picture.

    >>> stored_size((30, 40), 6)
    (40, 30)
    """
    return size if orientation < 5 else (size[1], size[0])


def drawn_upright(annotated: Size | None, size: Size, orientation: int) -> bool:
    """Whether an annotation was made on the upright picture: only where the size that it states says so.

    Args:
        annotated: size of the photograph according to the annotation.
        size: of the upright photograph.
        orientation: EXIF tag.

    >>> drawn_upright((30, 40), (30, 40), 6), drawn_upright((40, 30), (30, 40), 6), drawn_upright(None, (30, 40), 6)
    (True, False, False)
    """
    return orientation == 1 or (annotated == size != stored_size(size, orientation))


def turned_point(point: Point, size: Size, orientation: int) -> Point:
    """A keypoint of the stored picture in the upright one; one that is not annotated stays as it is.

    Args:
        point: x, y, annotated; pixels.
        size: of the upright photograph.
        orientation: EXIF tag.

    >>> turned_point((10.0, 0.0, 1.0), (30, 40), 6)
    (30.0, 10.0, 1.0)
    """
    x, y, flag = point
    if orientation not in _TURNS or not flag:
        return point
    return (*_TURNS[orientation](x, y, *stored_size(size, orientation)), flag)


def turned_box(box: Box, size: Size, orientation: int) -> Box:
    """A box of the stored picture in the upright one; arguments as for :func:`turned_point`.

    >>> turned_box((0.0, 0.0, 10.0, 5.0), (30, 40), 6)
    (25.0, 0.0, 30.0, 10.0)
    """
    (x0, y0, _), (x1, y1, _) = (turned_point((*corner, 1.0), size, orientation) for corner in (box[:2], box[2:]))
    return min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)

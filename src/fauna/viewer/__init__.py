"""What people see of a reconstruction: a page that shows it in 3D, and a turntable film.

Names are imported when first asked for: the page needs neither torch nor a rasteriser.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fauna.viewer.page import ViewerFrame, viewer_html, write_viewer
    from fauna.viewer.studio import portrait
    from fauna.viewer.turntable import turntable_frames, write_turntable
    from fauna.viewer.video import video_suffix, write_video

_HOMES = {
    "ViewerFrame": "page",
    "portrait": "studio",
    "turntable_frames": "turntable",
    "video_suffix": "video",
    "viewer_html": "page",
    "write_turntable": "turntable",
    "write_video": "video",
    "write_viewer": "page",
}
__all__ = [
    "ViewerFrame",
    "portrait",
    "turntable_frames",
    "video_suffix",
    "viewer_html",
    "write_turntable",
    "write_video",
    "write_viewer",
]


def __getattr__(name: str) -> Any:
    """One of the package's public names."""
    if name in _HOMES:
        return getattr(import_module(f"fauna.viewer.{_HOMES[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

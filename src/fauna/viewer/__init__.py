"""What people see of a reconstruction: a page that shows it in 3D, and a turntable video."""

from fauna.viewer.page import viewer_html, write_viewer

__all__ = ["viewer_html", "write_viewer"]

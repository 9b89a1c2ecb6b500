"""The demo's server with a studio that needs no model: ``python -m tests.demo.server PORT FOLDER MAX_MB MAX_WAITING``."""

import json
import os
import sys
import threading
import time
from pathlib import Path

import numpy as np


class FakeStudio:
    """Answers every photograph with the same small model; counts how many it works on at once."""

    def __init__(self) -> None:
        self.now = self.most = 0
        self.lock = threading.Lock()

    def show(self, photo: Path, folder: Path, *, fit_colours: bool):
        """Half a second of work."""
        from fauna.demo.studio import Shown
        from fauna.viewer import ViewerFrame, viewer_html
        from tests.models3d.glb_writer import write_quadruped

        with self.lock:
            self.now += 1
            self.most = max(self.most, self.now)
        time.sleep(0.2)
        path = folder / "horse.glb"
        if not hasattr(self, "glb"):
            self.glb = write_quadruped(path).read_bytes()
        path.write_bytes(self.glb)
        page = viewer_html(self.glb, title="horse", facts={"asked with": str(fit_colours)})
        with self.lock:
            self.now -= 1
        message = f"**ok**: {photo.stat().st_size} bytes, at most {self.most} at once"
        picture = np.full((40, 160, 3), 99, np.uint8)
        return Shown(picture, ViewerFrame(page, 400).html(), {"slot 3": 0.7, "slot 5": 0.3}, message, path)


def main() -> None:
    """Serve until killed."""
    port, folder, max_mb, max_waiting = int(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4])
    os.environ.update(GRADIO_ANALYTICS_ENABLED="False", GRADIO_TEMP_DIR=str(folder), HF_HUB_OFFLINE="1")
    import uvicorn

    from fauna.demo.app import build_app
    from fauna.demo.command import _listen

    app = build_app(FakeStudio(), folder, max_upload=max_mb * 2**20, max_waiting=max_waiting, host="127.0.0.1")  # type: ignore[arg-type]
    (folder.parent / "routes.json").write_text(json.dumps(sorted(set(_paths(app.app)))))  # type: ignore[attr-defined]
    listener = _listen("127.0.0.1", port)
    print(f"port {listener.getsockname()[1]}", flush=True)
    uvicorn.Server(uvicorn.Config(app, log_level="warning")).run(sockets=[listener])


def _paths(app, prefix=""):
    """Every route of an application, of those mounted in it and of the routers it includes."""
    for route in app.routes:
        inner = getattr(route, "original_router", route)
        if getattr(inner, "routes", None):
            yield from _paths(inner, prefix + getattr(route, "path", ""))
        elif hasattr(route, "path"):
            yield prefix + route.path


if __name__ == "__main__":
    main()

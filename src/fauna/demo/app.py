"""The page: Gradio components, and the application that is served. Needs the extra ``demo``."""

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from fauna.demo.bodies import App
from fauna.demo.guard import Guard
from fauna.demo.studio import HEIGHT, Shown, Studio

if TYPE_CHECKING:
    import gradio as gr  # pyright: ignore[reportMissingImports]

KEEP_SECONDS = 3600
"""How long uploads and results stay."""
STORED = 50
"""Largest photographs that the folder may hold; results count too."""
LOCAL = frozenset(("localhost", "127.0.0.1", "::1"))
INTRODUCTION = """# fauna
One photograph of a four-legged animal becomes a 3D model with a skeleton that moves. Everything happens on this computer."""
EMPTY = (
    f'<div style="height:{HEIGHT}px;display:grid;place-items:center;border:1px dashed var(--border-color-primary);border-radius:8px">'
    "The 3D model will appear here.</div>"
)
STYLE = "footer { display: none !important; } .gradio-container { max-width: 1280px !important; }"


def build_app(studio: Studio, folder: Path, *, max_upload: int, max_waiting: int, host: str) -> App:
    """The application, guarded. Needs Gradio, which reads the environment variable ``GRADIO_TEMP_DIR`` when it is first imported.

    Args:
        studio: reconstructs.
        folder: the only one whose files are served; it is Gradio's cache.
        max_upload: bytes of a photograph.
        max_waiting: photographs that may wait in the queue.
        host: address that is listened on; names of this computer are answered, and this one.
    """
    import gradio as gr  # pyright: ignore[reportMissingImports]
    from fastapi import FastAPI  # pyright: ignore[reportMissingImports]

    blocks = build_page(studio, folder).queue(max_size=max_waiting, default_concurrency_limit=1, api_open=False)
    app = gr.mount_gradio_app(
        FastAPI(docs_url=None, redoc_url=None, openapi_url=None),
        blocks,
        path="/",
        server_name=host,
        footer_links=[],
        run_history=False,
        allowed_paths=[],
        show_error=False,  # messages of unforeseen errors may name folders
        max_file_size=max_upload,
        ssr_mode=False,
        enable_monitoring=False,
        pwa=False,
        mcp_server=False,
        theme=gr.themes.Base(primary_hue="green", font=["system-ui", "sans-serif"], font_mono=["monospace"]),
        css=STYLE,
    )
    blocks.has_launched = True  # else a mounted page does not check whether files in calls were uploaded (Gradio 6.31)
    anywhere = host in ("0.0.0.0", "::")
    return Guard(
        app,
        hosts=frozenset() if anywhere else LOCAL | {host.lower()},
        folder=folder,
        max_upload=max_upload,
        max_stored=STORED * max_upload,
        keep_seconds=KEEP_SECONDS,
    )


def build_page(studio: Studio, folder: Path) -> "gr.Blocks":
    """The components and what happens when a photograph comes in."""
    import gradio as gr  # pyright: ignore[reportMissingImports]

    with gr.Blocks(analytics_enabled=False, title="fauna") as page:
        gr.Markdown(INTRODUCTION)
        with gr.Row():
            with gr.Column(scale=2, min_width=280):
                photo = gr.Image(
                    type="filepath",
                    image_mode=None,
                    sources=["upload", "clipboard"],
                    label="Photograph",
                    height=300,
                    buttons=["fullscreen"],
                )
                photo.preprocess = _path  # type: ignore[method-assign]  # the file as it is: fauna reads it, within limits
                colours = gr.Checkbox(value=True, label="Fit the colours to the photograph (takes a few seconds more)")
                start = gr.Button("Make it 3D", variant="primary")
                message = gr.Markdown()
                bank = gr.Label(
                    label="Where its shape comes from (slots of the bank)",
                    num_top_classes=6,
                    show_heading=False,
                    visible=False,
                )
            with gr.Column(scale=5, min_width=360):
                viewer = gr.HTML(EMPTY, label="3D model")
                glb = gr.DownloadButton("Download GLB", interactive=False)
        pictures = gr.Image(
            label="How it was understood",
            format="png",
            interactive=False,
            visible=False,
            buttons=["download", "fullscreen"],
        )

        def run(path: str | None, fit_colours: bool) -> tuple[Any, ...]:
            if not path:
                raise gr.Error("Drag a photograph into the field first.", print_exception=False)
            shown = studio.show(Path(path), Path(tempfile.mkdtemp(dir=folder)), fit_colours=fit_colours)
            return _outputs(shown)

        start.click(
            run, [photo, colours], [viewer, pictures, bank, message, glb], api_name="reconstruct", concurrency_limit=1
        )
    return page


def _path(payload: Any) -> str | None:
    return None if payload is None else payload.path


def _outputs(shown: Shown) -> tuple[Any, ...]:
    import gradio as gr  # pyright: ignore[reportMissingImports]

    return (
        shown.viewer or EMPTY,
        gr.update(value=shown.pictures, visible=shown.pictures is not None),
        gr.update(value=shown.bank or None, visible=bool(shown.bank)),
        shown.message,
        gr.update(value=None if shown.glb is None else str(shown.glb), interactive=shown.glb is not None),
    )

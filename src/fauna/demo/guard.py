"""What stands between the network and Gradio: known addresses only, bounded bodies, no foreign host, no foreign content.

Gradio offers many routes that this page does not use. Rather than trusting each of them, only those that the page calls are let
through; everything else is answered with 404 here. And rather than trusting its own checks of file names, which do not run in a mounted
application (Gradio 6.31), calls that name a file outside of the page's folder end here too.
"""

import asyncio
import json
import re
import time
from pathlib import Path
from typing import Any
from urllib.parse import unquote

from fauna.demo.bodies import App, Counted, Message, Receive, Scope, Send, TooLarge, replay

READ = re.compile(
    r"/|/config|/theme\.css|/favicon\.ico|/manifest\.json|/(assets|static|svelte)/[\w./@+-]+"
    r"|/gradio_api/(info|app_id|startup-events|heartbeat/\w+|queue/data|upload_progress|theme\.css|file=.+)"
)
"""Addresses that may be read, without query."""
UPLOAD = re.compile(r"/gradio_api/upload")
CALL = re.compile(r"/gradio_api/(queue/join|cancel|reset)/?")
"""Addresses that take JSON."""
MAX_CALL = 65536
"""Bytes of JSON; photographs come by upload."""
OVERHEAD = 65536
"""Bytes that an upload's form may need around the file."""

HEADERS = {
    "content-security-policy": (
        "default-src 'self'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; style-src 'self' 'unsafe-inline'; "
        "img-src 'self' data: blob:; connect-src 'self' blob: data:; font-src 'self' data:; media-src 'self' blob: data:; "
        "frame-src 'self' blob: data:; worker-src 'self' blob:; frame-ancestors 'none'; base-uri 'self'; form-action 'self'; object-src 'none'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-resource-policy": "same-origin",
}


class Guard:
    """ASGI middleware.

    Args:
        app: what is guarded.
        hosts: values of the Host header that are answered, without port; empty for any. A page elsewhere that points its own
            name at this computer gets no answer.
        folder: the only one whose files may be named and are served; uploads and results lie in it.
        max_upload: bytes of an uploaded file.
        max_stored: bytes in the folder beyond which uploads are turned away.
        keep_seconds: how long files stay in the folder.
    """

    def __init__(
        self, app: App, *, hosts: frozenset[str], folder: Path, max_upload: int, max_stored: int, keep_seconds: int
    ) -> None:
        self.app = app
        self.hosts = hosts
        self.folder = folder.resolve()
        self.max_upload = max_upload
        self.max_stored = max_stored
        self.keep_seconds = keep_seconds

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let a request through or answer it."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        if scope["type"] != "http":
            return  # no websockets here
        status, limit = self._judge(scope)
        if status:
            await _answer(send, *status)
            return
        counted = Counted(receive, limit)
        if CALL.fullmatch(scope["path"]) and scope["method"] == "POST":
            body = await counted.all()
            if body is None or not self._harmless(body):
                await _answer(send, 413 if body is None else 400, "expected a small call with files of this page only")
                return
            await self.app(scope, replay(body, receive), _with_headers(send))
            return
        if (
            UPLOAD.fullmatch(scope["path"])
            and await asyncio.to_thread(tidy, self.folder, self.keep_seconds) > self.max_stored
        ):
            await _answer(send, 507, "expected room for another photograph, got a full folder; try again in an hour")
            return
        await self._pass(scope, counted, send)

    async def _pass(self, scope: Scope, counted: "Counted", send: Send) -> None:
        begun = False

        async def watched(message: Message) -> None:
            nonlocal begun
            if counted.exceeded and not begun:
                begun = True
                await _answer(send, 413, self._too_large)
            elif not counted.exceeded:
                begun = True
                await _with_headers(send)(message)

        try:
            await self.app(scope, counted, watched)
        except TooLarge:
            if not begun:
                await _answer(send, 413, self._too_large)

    def _judge(self, scope: Scope) -> tuple[tuple[int, str] | None, int]:
        """An answer, or ``None``; and how many bytes the body may have."""
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        path, method = scope["path"], scope["method"]
        if self.hosts and _hostname(headers.get("host", "")) not in self.hosts:
            return (421, "expected this computer's own address; open the page as it was printed"), 0
        if not _plain_path(path, scope.get("raw_path") or path.encode()):
            return (400, "expected a plain address"), 0
        if method in ("GET", "HEAD") and READ.fullmatch(path):
            _, named, file = path.partition("/gradio_api/file=")
            return (None if not named or self._own(file) else (404, "no such file")), 0
        if method == "POST" and (UPLOAD.fullmatch(path) or CALL.fullmatch(path)):
            limit = MAX_CALL if CALL.fullmatch(path) else self.max_upload + OVERHEAD
            length = headers.get("content-length", "0")
            if not length.isdigit() or int(length) > limit:
                return (413, self._too_large), 0
            return None, limit
        return (404, "no such page"), 0

    def _harmless(self, body: bytes) -> bool:
        """Whether it is JSON, and every file it names lies in the folder; addresses of the network do not, which Gradio would fetch."""
        try:
            content = json.loads(body or b"null")
        except (ValueError, RecursionError):
            return False
        waiting = [content]
        while waiting:
            node = waiting.pop()
            if isinstance(node, dict):
                if node.get("path") is not None and not self._own(node["path"]):
                    return False
                waiting += node.values()
            elif isinstance(node, list):
                waiting += node
        return True

    def _own(self, name: Any) -> bool:
        """Whether it is the full name of a file in the folder, also after links are followed."""
        try:
            return (
                isinstance(name, str) and Path(name).is_absolute() and Path(name).resolve().is_relative_to(self.folder)
            )
        except (OSError, ValueError):  # a name that no file can have
            return False

    @property
    def _too_large(self) -> str:
        return f"expected at most {self.max_upload // 2**20} MB, got more; make the photograph smaller"


def tidy(folder: Path, keep_seconds: int) -> int:
    """Remove files that were last written longer ago; the bytes of those that stay."""
    oldest, total = time.time() - keep_seconds, 0
    for path in folder.rglob("*"):
        try:
            found = path.lstat()
            if path.is_dir() and not path.is_symlink():
                continue
            if found.st_mtime < oldest:
                path.unlink()
            else:
                total += found.st_size
        except FileNotFoundError:  # somebody else removed it
            continue
    return total


def _plain_path(path: str, raw: bytes) -> bool:
    """No step upwards, no backslash, no control character, however often it was encoded."""
    text = raw.decode("latin-1")
    for _ in range(4):
        if any(part == ".." for part in re.split(r"[/\\=]", text)) or re.search(r"[\\\x00-\x1f]", text):
            return False
        text = unquote(text)
    return ".." not in re.split(r"[/\\=]", path)


def _hostname(host: str) -> str:
    return host[1 : host.index("]")] if host.startswith("[") and "]" in host else host.split(":")[0].lower()


def _with_headers(send: Send) -> Send:
    async def extended(message: Message) -> None:
        if message["type"] == "http.response.start":
            ours = [(name.encode(), value.encode()) for name, value in HEADERS.items()]
            kept = [pair for pair in message.get("headers", []) if pair[0].decode("latin-1").lower() not in HEADERS]
            message = {**message, "headers": kept + ours}
        await send(message)

    return extended


async def _answer(send: Send, status: int, text: str) -> None:
    body = (text + "\n").encode()
    headers = [
        (b"content-type", b"text/plain; charset=utf-8"),
        (b"content-length", str(len(body)).encode()),
        (b"connection", b"close"),
    ]
    await _with_headers(send)({"type": "http.response.start", "status": status, "headers": headers})
    await send({"type": "http.response.body", "body": body})

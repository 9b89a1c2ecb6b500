"""What the guard lets through to the page's server, and what it answers itself."""

import asyncio
import json
import os
import time
from pathlib import Path

import pytest

from fauna.demo.guard import HEADERS, MAX_CALL, Guard

MB = 2**20
OWN = "/somewhere/fauna-demo"


async def _echo(scope, receive, send):
    """An application that reads its body and says how long it was."""
    length, more = 0, True
    while more:
        message = await receive()
        length += len(message.get("body", b""))
        more = message.get("more_body", False)
    headers = [(b"content-type", b"text/plain"), (b"referrer-policy", b"unsafe-url")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": str(length).encode()})


def _ask(path, method="GET", body=b"", *, host="127.0.0.1:7860", length=None, parts=1, raw=None, folder=None):
    """Status, headers and text of an answer."""
    guard = Guard(
        _echo,
        hosts=frozenset({"127.0.0.1", "::1"}),
        folder=folder or Path(OWN),
        max_upload=MB,
        max_stored=3 * MB,
        keep_seconds=60,
    )
    headers = [(b"host", host.encode())] + ([] if length is None else [(b"content-length", str(length).encode())])
    scope = {"type": "http", "method": method, "path": path, "raw_path": raw or path.encode(), "headers": headers}
    size = max(1, -(-len(body) // parts))
    chunks = [body[start : start + size] for start in range(0, len(body), size)] or [b""]
    waiting = [
        {"type": "http.request", "body": chunk, "more_body": number < len(chunks) - 1}
        for number, chunk in enumerate(chunks)
    ]
    sent = []

    async def receive():
        return waiting.pop(0)

    async def send(message):
        sent.append(message)

    asyncio.run(guard(scope, receive, send))
    start, *rest = sent
    return start["status"], dict(start["headers"]), b"".join(part["body"] for part in rest).decode()


@pytest.mark.parametrize(
    "path",
    [
        "/",
        "/config",
        "/theme.css",
        "/assets/index-Ab1.js",
        "/gradio_api/queue/data",
        f"/gradio_api/file={OWN}/photo 1.png",
    ],
)
def test_what_the_page_reads_is_let_through(path):
    status, headers, text = _ask(path)
    assert (status, text) == (200, "0")
    for name, value in HEADERS.items():
        assert headers[name.encode()] == value.encode()


@pytest.mark.parametrize(
    "path",
    [
        "/gradio_api/proxy=http://example.org/", "/gradio_api/run/reconstruct", "/gradio_api/call/reconstruct", "/gradio_api/api/reconstruct",
        "/gradio_api/vibe-edit/", "/gradio_api/process_recording", "/gradio_api/stream/1", "/monitoring", "/monitoring/summary",
        "/gradio_api/custom_component/1/client/component/a.js", "/gradio_api/dev/reload", "/login", "/docs", "/openapi.json",
        "/gradio_api/openapi.json", "/gradio_api/deep_link", "/gradio_api/component_server", "/gradio_api/runs",
    ],
)  # fmt: skip
def test_what_the_page_does_not_need_is_not_there(path):
    assert _ask(path)[0] == 404
    assert _ask(path, "POST", b"{}")[0] == 404


@pytest.mark.parametrize("method", ["PUT", "DELETE", "PATCH", "OPTIONS", "TRACE"])
def test_other_methods_are_not_there(method):
    assert _ask("/config", method)[0] == 404


@pytest.mark.parametrize(
    ("path", "raw"),
    [
        ("/gradio_api/file=../../etc/passwd", None),
        ("/gradio_api/file=/var/../etc/passwd", None),
        ("/assets/../../secret", b"/assets/%2e%2e/%2e%2e/secret"),
        ("/assets/%2e%2e/secret", b"/assets/%252e%252e/secret"),
        ("/assets/%252e%252e/secret", b"/assets/%25252e%25252e/secret"),
        ("/static/..\\..\\secret", b"/static/..%5c..%5csecret"),
        ("/static/a\x00b", b"/static/a%00b"),
    ],
)
def test_steps_upwards_are_refused_however_they_are_written(path, raw):
    assert _ask(path, raw=raw)[0] in (400, 404)


def test_dots_in_names_are_no_steps():
    assert _ask(f"/gradio_api/file={OWN}/my..photo.png")[0] == 200


@pytest.mark.parametrize("host", ["example.org", "evil.127.0.0.1.nip.io:7860", "", "127.0.0.1.evil.org"])
def test_foreign_names_get_no_answer(host):
    assert _ask("/", host=host)[0] == 421


def test_addresses_of_ipv6_are_known():
    assert _ask("/", host="[::1]:7860")[0] == 200


def test_uploads_are_bounded_by_what_they_say_and_by_what_they_send():
    assert _ask("/gradio_api/upload", "POST", b"x" * MB, length=MB)[0] == 200
    assert _ask("/gradio_api/upload", "POST", b"", length=200 * MB)[0] == 413
    assert _ask("/gradio_api/upload", "POST", b"", length="many")[0] == 413
    status, _, text = _ask("/gradio_api/upload", "POST", b"x" * (2 * MB), parts=50)  # says nothing
    assert status == 413
    assert text == "expected at most 1 MB, got more; make the photograph smaller\n"
    assert _ask("/gradio_api/upload", "POST", b"x" * (2 * MB), parts=50, length=10)[0] == 413  # lies


def test_calls_are_small():
    assert _ask("/gradio_api/queue/join", "POST", b'"' + b"x" * MAX_CALL + b'"', parts=3)[0] == 413
    assert _ask("/gradio_api/queue/join", "POST", b'{"data": [1]}')[::2] == (200, "13")


PLACES = [
    "http://127.0.0.1:9/", "https://example.org/a.png", " http://x", "file:///etc/passwd", "data:,", "/etc/passwd", "etc/passwd", "",
    f"{OWN}/../secret", f"{OWN}-too/secret", f"{OWN}/a/../../secret", f"//{OWN}/../secret", "~/secret", "a\x00b", "x" * 5000, 7, ["/etc/passwd"],
]  # fmt: skip


@pytest.mark.parametrize("place", PLACES)
def test_calls_cannot_name_a_file_from_elsewhere(place):
    body = json.dumps({"data": [{"deep": [{"path": place, "meta": {"_type": "gradio.FileData"}}]}]})
    assert _ask("/gradio_api/queue/join", "POST", body.encode())[0] == 400
    if isinstance(place, str):
        hidden = body.replace(json.dumps(place), '"' + "".join(f"\\u{ord(letter):04x}" for letter in place) + '"')
        assert _ask("/gradio_api/queue/join", "POST", hidden.encode())[0] == 400
        assert _ask(f"/gradio_api/file={place}")[0] in (400, 404)


def test_links_that_lead_elsewhere_are_followed(tmp_path):
    own = tmp_path / "own"
    own.mkdir()
    (tmp_path / "secret").write_text("secret")
    (own / "link").symlink_to(tmp_path / "secret")
    (own / "photo").write_text("photo")
    assert _ask(f"/gradio_api/file={own}/link", folder=own)[0] == 404
    assert _ask(f"/gradio_api/file={own}/photo", folder=own)[0] == 200


def test_a_full_folder_takes_no_more_and_old_files_make_room(tmp_path):
    for name in ("a", "b", "c", "d"):
        (tmp_path / name).write_bytes(b"x" * MB)
    status, _, text = _ask("/gradio_api/upload", "POST", b"x", folder=tmp_path)
    assert status == 507
    assert "got a full folder" in text
    os.utime(tmp_path / "a", (0, time.time() - 61))
    assert _ask("/gradio_api/upload", "POST", b"x", folder=tmp_path)[0] == 200
    assert sorted(path.name for path in tmp_path.iterdir()) == ["b", "c", "d"]


def test_files_of_the_page_may_be_named_with_their_address():
    body = {
        "data": [{"path": f"{OWN}/ab/photo.png", "url": f"http://127.0.0.1:7860/gradio_api/file={OWN}/ab/photo.png"}]
    }
    assert _ask("/gradio_api/queue/join", "POST", json.dumps(body).encode())[0] == 200


@pytest.mark.parametrize("body", [b"{", b"\xff", b"[" * 60000])
def test_calls_that_are_no_json_are_refused(body):
    assert _ask("/gradio_api/queue/join", "POST", body)[0] == 400

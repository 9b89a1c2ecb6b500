"""The demo's limits, tried on a running server: foreign files, large uploads, many at once. Needs Gradio, not a model."""

import concurrent.futures
import http.client
import importlib.util
import json
import os
import socket
import subprocess
import sys
import time
import uuid
from pathlib import Path

import pytest

from tests.viewer.browser import look_at, needs_chromium

pytestmark = pytest.mark.skipif(importlib.util.find_spec("gradio") is None, reason="needs the extra demo")
MAX_MB, MAX_WAITING, TOKEN = 2, 10, f"secret-{uuid.uuid4().hex}"


class Server:
    """A running server: where it is, and its process."""

    def __init__(self, folder: Path) -> None:
        own = folder / "own"
        own.mkdir()
        (folder / "secret.txt").write_text(TOKEN)
        (own.parent / "own-too").mkdir()
        (own.parent / "own-too" / "secret.txt").write_text(TOKEN)
        self.folder, self.log = folder, (folder / "log.txt").open("w+")
        root = Path(__file__).parents[2]
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.demo.server", "0", str(own), str(MAX_MB), str(MAX_WAITING)],
            cwd=root, env={**os.environ, "PYTHONPATH": f"{root / 'src'}{os.pathsep}{root}"}, stdout=subprocess.PIPE, stderr=self.log,
            text=True,
        )  # fmt: skip
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        assert line.startswith("port "), (folder / "log.txt").read_text()
        self.port = int(line.split()[1])
        self.routes = json.loads((folder / "routes.json").read_text())

    def ask(self, method: str, path: str, body=None, headers=None, *, read: int = 10_000_000) -> tuple[int, bytes]:
        """Status and body; the path goes out as it is."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body=body, headers=headers or {})
            answer = connection.getresponse()
            return answer.status, answer.read(read)
        finally:
            connection.close()

    def call(self, method: str, path: str, content) -> tuple[int, bytes]:
        """With JSON."""
        return self.ask(method, path, json.dumps(content), {"content-type": "application/json"})

    def upload(self, name: str, content: bytes) -> tuple[int, bytes]:
        """A file by the page's form."""
        head = (
            f'--x\r\ncontent-disposition: form-data; name="files"; filename="{name}"\r\ncontent-type: image/png\r\n\r\n'
        )
        body = head.encode() + content + b"\r\n--x--\r\n"
        return self.ask("POST", "/gradio_api/upload", body, {"content-type": "multipart/form-data; boundary=x"})

    def memory(self) -> int:
        """Resident bytes of the server."""
        line = next(
            x for x in Path(f"/proc/{self.process.pid}/status").read_text().splitlines() if x.startswith("VmHWM")
        )
        return 1024 * int(line.split()[1])


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    running = Server(tmp_path_factory.mktemp("demo"))
    yield running
    running.process.terminate()
    running.process.wait(20)


def _ways(target: Path) -> list[str]:
    """A path written in the ways that servers have fallen for."""
    plain = str(target)
    climbing = "../" * 12 + plain.lstrip("/")
    return [
        plain, plain.lstrip("/"), climbing, climbing.replace("../", "..%2f"), climbing.replace("../", "%2e%2e/"),
        climbing.replace("../", "%252e%252e%252f"), climbing.replace("../", "....//"), climbing.replace("/", "\\").replace("\\", "%5c"),
        "/" + plain, "file://" + plain, plain + "%00.png", plain.replace("/", "%2f"), "~/../.." + plain, "./" + climbing,
        f"http://127.0.0.1{plain}", climbing.replace("../", "..;/"),
    ]  # fmt: skip


def test_no_route_serves_a_file_from_elsewhere(server):
    """Every route that Gradio has, with every spelling in the place of every parameter; and a file it does serve, to see the check work."""
    targets = [server.folder / "secret.txt", server.folder / "own-too" / "secret.txt"]
    ways = [way for target in targets for way in _ways(target)] + _ways(Path("/etc/passwd")) + _ways(Path(__file__))
    prefixes = sorted({route.split("{")[0] for route in server.routes if "{" in route})
    prefixes += ["/", "/gradio_api/file=", "/gradio_api/file/", "/file=", "/static/", "/assets/", "/theme.css?x="]
    assert len(server.routes) > 40
    assert "/gradio_api/file=" in prefixes[:-7]
    tried = 0
    for prefix in prefixes:
        for way in ways:
            status, body = server.ask("GET", prefix + way)
            tried += 1
            assert TOKEN.encode() not in body, (prefix, way)
            assert b"root:" not in body, (prefix, way)
            assert b"every parameter; and a file" not in body, (prefix, way)
            assert status != 500, (prefix, way)
    assert tried > 500


def test_calls_cannot_name_a_file_from_elsewhere(server):
    for way in [*_ways(server.folder / "secret.txt"), *_ways(Path("/etc/passwd"))]:
        answer = _run(server, {"path": way, "meta": {"_type": "gradio.FileData"}})
        assert TOKEN not in answer
        assert "root:" not in answer
        assert "bytes, at most" not in answer, way  # the studio never saw it


def test_names_of_uploads_do_not_climb(server):
    before = {path for path in server.folder.rglob("*") if "own" not in path.relative_to(server.folder).parts[:1]}
    for name in (
        "../../climbed.png",
        "..%2f..%2fclimbed.png",
        "/var/climbed.png",
        "..\\..\\climbed.png",
        "a" * 400 + ".png",
    ):
        status, body = server.upload(name, b"x")
        if status == 200:
            (stored,) = json.loads(body)
            assert Path(stored).resolve().is_relative_to(server.folder / "own")
    assert {
        path for path in server.folder.rglob("*") if "own" not in path.relative_to(server.folder).parts[:1]
    } == before


def test_settings_of_the_page_name_no_folder_and_no_other_host(server):
    status, body = server.ask("GET", "/config")
    assert status == 200
    assert str(server.folder).encode() not in body
    assert str(Path.home()).encode() + b"/" not in body
    assert json.loads(body)["analytics_enabled"] is False
    assert b"fonts.googleapis" not in server.ask("GET", "/theme.css")[1]


def test_a_large_upload_is_cut_off(server):
    """200 MB: announced, in pieces without a length, and with a wrong one; the server stays small."""
    before, stored = server.memory(), _bytes_below(server.folder)
    head = b'--x\r\ncontent-disposition: form-data; name="files"; filename="a.png"\r\n\r\n'
    kind = "content-type: multipart/form-data; boundary=x"
    assert _pour(server, f"{kind}\r\ncontent-length: {200 * 2**20}", head)[1] == 413
    sent, status = _pour(server, f"{kind}\r\ntransfer-encoding: chunked", head, chunked=True)
    assert status in (413, None)  # None: the connection was closed on us
    assert sent < 50 * 2**20
    assert server.memory() - before < 40 * 2**20
    assert _bytes_below(server.folder) - stored < (MAX_MB + 1) * 2**20  # what was cut off stays for an hour
    assert server.upload("small.png", b"x" * 2**20)[0] == 200
    assert server.upload("large.png", b"x" * (MAX_MB * 2**20 + 1))[0] == 413


def test_fifty_at_once_are_queued_or_turned_away(server):
    (photo,) = json.loads(server.upload("photo.png", b"12345")[1])
    file = {"path": photo, "meta": {"_type": "gradio.FileData"}}
    with concurrent.futures.ThreadPoolExecutor(50) as pool:
        answers = list(pool.map(lambda _: _run(server, file), range(50)))
    served = [answer for answer in answers if "5 bytes, at most 1 at once" in answer]
    turned_away = [answer for answer in answers if "queue is full" in answer.lower()]
    assert len(served) + len(turned_away) == 50
    assert MAX_WAITING <= len(served) < 50
    assert "bytes, at most 1 at once" in _run(server, file)  # and then goes on as before


def test_the_result_is_downloaded_and_other_names_beside_it_are_not(server):
    (photo,) = json.loads(server.upload("photo.png", b"12345")[1])
    answer = _run(server, {"path": photo, "meta": {"_type": "gradio.FileData"}})
    finished = json.loads(
        next(line for line in answer.splitlines() if "process_completed" in line).removeprefix("data: ")
    )
    glb = next(
        each["value"]["path"]
        for each in finished["output"]["data"]
        if isinstance(each, dict) and "glb" in str(each.get("value"))
    )
    status, body = server.ask("GET", f"/gradio_api/file={glb}")
    assert (status, body[:4]) == (200, b"glTF")
    assert server.ask("GET", f"/gradio_api/file={Path(glb).parent}")[0] in (403, 404)


@needs_chromium
def test_the_page_opens_in_a_browser_without_a_word(server, tmp_path):
    seen = look_at(f"http://127.0.0.1:{server.port}/", tmp_path)
    assert "Make it 3D" in seen.document
    assert [line for line in seen.console if "Method not implemented" not in line] == []
    assert {url.split("/")[2] for url in seen.requests} == {f"127.0.0.1:{server.port}"}
    assert seen.picture.std() > 3


def _run(server: Server, file) -> str:
    """What the page's button does with an uploaded file: everything the queue says about it."""
    config = json.loads(server.ask("GET", "/config")[1])
    function = next(each["id"] for each in config["dependencies"] if each["api_name"] == "reconstruct")
    session = uuid.uuid4().hex[:10]
    asked = {
        "data": [file, False],
        "fn_index": function,
        "session_hash": session,
        "trigger_id": None,
        "event_data": None,
    }
    status, body = server.call("POST", "/gradio_api/queue/join", asked)
    if status != 200:
        return body.decode(errors="replace")
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=120)
    connection.request("GET", f"/gradio_api/queue/data?session_hash={session}")
    answer, said = connection.getresponse(), []
    while line := answer.readline().decode():
        said.append(line)
        if '"process_completed"' in line or '"close_stream"' in line or '"unexpected_error"' in line:
            break
    connection.close()
    return "".join(said)


def _pour(server: Server, headers: str, head: bytes, *, chunked: bool = False) -> tuple[int, int | None]:
    """Send 200 MB whatever the server says; how much went out, and the status if there was one."""
    piece = b"x" * 2**20
    sent = 0
    with socket.create_connection(("127.0.0.1", server.port), timeout=30) as stream:
        stream.sendall(f"POST /gradio_api/upload HTTP/1.1\r\nhost: 127.0.0.1\r\n{headers}\r\n\r\n".encode())
        try:
            for content in [head] + [piece] * 200:
                stream.sendall(f"{len(content):x}\r\n".encode() + content + b"\r\n" if chunked else content)
                sent += len(content)
        except OSError:
            time.sleep(0.1)
        try:
            start = stream.recv(100)
        except OSError:
            return sent, None
    return sent, int(start.split()[1]) if start.startswith(b"HTTP/1.1 ") else None


def _bytes_below(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())

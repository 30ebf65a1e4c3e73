"""The Hugging Face Hub as far as its file system asks it: one data set, on a port of this machine."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

REPOSITORY = "datasets/user/set"
_COMMIT = "c" * 40


def _file(name: str, data: bytes) -> dict[str, Any]:
    date = {"id": _COMMIT, "title": "", "date": "2024-01-01T00:00:00.000Z"}
    oid = hashlib.sha1(data, usedforsecurity=False).hexdigest()
    return {"type": "file", "oid": oid, "size": len(data), "path": name, "lastCommit": date}


@contextmanager
def hub_server(files: dict[str, bytes]) -> Iterator[str]:
    """Of the files by their names, as they are whenever it is asked; yields its address."""

    class Hub(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def answer(self, status: int, found: Any, **headers: str) -> None:
            data = found if isinstance(found, bytes) else json.dumps(found).encode()
            self.send_response(status)
            for name, value in {**headers, "Content-Length": str(len(data))}.items():
                self.send_header(name.replace("_", "-"), value)
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        def do_GET(self) -> None:
            path = unquote(urlsplit(self.path).path)
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0)).decode()
            if re.fullmatch(rf"/api/{REPOSITORY}(/revision/main)?", path):
                return self.answer(200, {"id": "user/set", "sha": _COMMIT, "siblings": []})
            if re.fullmatch(rf"/api/{REPOSITORY}/paths-info/\w+", path):
                asked = json.loads(body)["paths"] if body.startswith("{") else parse_qs(body)["paths"]
                return self.answer(200, [_file(name, files[name]) for name in asked if name in files])
            if re.fullmatch(rf"/api/{REPOSITORY}/tree/\w+", path):
                return self.answer(200, [_file(name, data) for name, data in files.items()])
            found = re.fullmatch(rf"/{REPOSITORY}/resolve/\w+/(.*)", path)
            if found and found[1] in files:
                return self.answer(200, files[found[1]], ETag='"any"', X_Repo_Commit=_COMMIT)
            return self.answer(
                404, {"error": "none"}, X_Error_Code="EntryNotFound" if found else "RepoNotFound"
            )

        do_POST = do_HEAD = do_GET

    with ThreadingHTTPServer(("127.0.0.1", 0), Hub) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()

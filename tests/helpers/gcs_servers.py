"""Google Cloud Storage as far as its file system asks it, by its JSON API: one bucket, on a port of this machine."""

from __future__ import annotations

import hashlib
import json
import re
import threading
from base64 import b64encode
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

BUCKET = "pictures"
_PAGE = 2  # objects


@contextmanager
def gcs_server(objects: dict[str, bytes]) -> Iterator[str]:
    """Of the objects by their names, as they are whenever it is asked; yields its address."""
    lock = threading.Lock()

    def about(name: str) -> dict[str, str]:
        data = objects[name]
        digest = hashlib.md5(data, usedforsecurity=False)
        generation = str(int(digest.hexdigest()[:12], 16))
        date = "2024-01-01T00:00:00.000Z"
        return {
            "kind": "storage#object", "bucket": BUCKET, "name": name, "size": str(len(data)), "updated": date,
            "timeCreated": date, "generation": generation, "etag": f"{generation}-{digest.hexdigest()}",
            "md5Hash": b64encode(digest.digest()).decode(), "contentType": "application/octet-stream",
        }  # fmt: skip

    def listed(asked: dict[str, str]) -> dict[str, Any]:
        prefix, delimiter = asked.get("prefix", ""), asked.get("delimiter", "")
        entries = dict[str, bool]()  # whether it is a prefix
        for name in sorted(name for name in objects if name.startswith(prefix)):
            head, found, _ = name[len(prefix) :].partition(delimiter) if delimiter else (name, "", "")
            entries[prefix + head + found if found else name] = bool(found)
        begin = int(asked.get("pageToken", 0))
        page = list(entries.items())[begin : begin + _PAGE]
        answer: dict[str, Any] = {
            "kind": "storage#objects",
            "items": [about(name) for name, is_prefix in page if not is_prefix],
            "prefixes": [name for name, is_prefix in page if is_prefix],
        }
        return answer | ({"nextPageToken": str(begin + _PAGE)} if begin + _PAGE < len(entries) else {})

    class Storage(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_: object) -> None:
            pass

        def answer(self, status: int, found: Any = None) -> None:
            if status >= 400:
                found = {"error": {"code": status, "message": f"{found}", "errors": [{"reason": f"{found}"}]}}
            data = found if isinstance(found, bytes) else json.dumps(found).encode()
            self.send_response(status)
            self.send_header("Content-Type", "application/json; charset=UTF-8")
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def handle_any(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length") or 0))
            url = urlsplit(self.path)
            asked = {name: values[0] for name, values in parse_qs(url.query).items()}
            found = re.fullmatch(r"/(?:(?:upload|download)/)?storage/v1/b/([^/]+)(/o(?:/(.*))?)?", url.path)
            with lock:
                if found is None or found[1] != BUCKET:
                    return self.answer(404, "notFound")
                if self.command == "POST":
                    return self.put(body, asked)
                if found[2] is None:
                    return self.answer(200, {"kind": "storage#bucket", "name": BUCKET})
                if found[3] is None:
                    return self.answer(200, listed(asked))
                return self.of_object(unquote(found[3]), asked)

        def of_object(self, name: str, asked: dict[str, str]) -> None:
            if name not in objects:
                return self.answer(404, "notFound")
            if self.command == "DELETE":
                del objects[name]
                return self.answer(200, b"")
            return self.answer(200, objects[name] if asked.get("alt") == "media" else about(name))

        def put(self, body: bytes, asked: dict[str, str]) -> None:
            _, head, rest = body.split(b"--==0==", 2)[0], *body.split(b"--==0==", 2)[1:]
            name = json.loads(head.split(b"\n\n", 1)[1])["name"]
            if asked.get("ifGenerationMatch") == "0" and name in objects:
                return self.answer(412, "conditionNotMet")
            objects[name] = rest.split(b"\n\n", 1)[1].removesuffix(b"\n--==0==--")
            return self.answer(200, about(name))

        do_GET = do_POST = do_DELETE = handle_any

    with ThreadingHTTPServer(("127.0.0.1", 0), Storage) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()

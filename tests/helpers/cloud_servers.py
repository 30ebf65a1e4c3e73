"""Google Cloud Storage and the Hugging Face Hub as far as their file systems ask them, on ports of this machine."""

import hashlib
import json
import re
import threading
from base64 import b64encode
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

BUCKET, REPOSITORY = "pictures", "datasets/user/set"
_PAGE = 2  # objects
_COMMIT, _DATE = "c" * 40, "2024-01-01T00:00:00.000Z"
Answer = tuple[int, Any, dict[str, str]]


@contextmanager
def _server(answer):
    """Of an answer to method, path, query and body; yields its address."""
    lock = threading.Lock()

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def log_message(self, *_):
            pass

        def do_GET(self):
            url, body = urlsplit(self.path), self.rfile.read(int(self.headers.get("Content-Length") or 0))
            asked = {name: values[0] for name, values in parse_qs(url.query).items()}
            with lock:
                status, found, headers = answer(self.command, url.path, asked, body)
            data = found if isinstance(found, bytes) else json.dumps(found).encode()
            self.send_response(status)
            for name, value in {"Content-Type": "application/json", **headers}.items():
                self.send_header(name, value)
            self.send_header("Content-Length", str(len(data)))
            self.end_headers()
            if self.command != "HEAD":
                self.wfile.write(data)

        do_POST = do_HEAD = do_DELETE = do_GET

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@contextmanager
def gcs_server(objects):
    """A bucket of the objects by their names, as they are whenever it is asked."""

    def about(name):
        digest = hashlib.md5(objects[name], usedforsecurity=False)
        generation = str(int(digest.hexdigest()[:12], 16))
        return {
            "kind": "storage#object", "bucket": BUCKET, "name": name, "size": str(len(objects[name])),
            "updated": _DATE, "timeCreated": _DATE, "generation": generation, "etag": digest.hexdigest(),
            "md5Hash": b64encode(digest.digest()).decode(), "contentType": "application/octet-stream",
        }  # fmt: skip

    def listed(asked):
        prefix, delimiter = asked.get("prefix", ""), asked.get("delimiter", "")
        entries = dict[str, bool]()  # whether it is a prefix
        for name in sorted(name for name in objects if name.startswith(prefix)):
            head, found, _ = name[len(prefix) :].partition(delimiter) if delimiter else (name, "", "")
            entries[prefix + head + found if found else name] = bool(found)
        begin = int(asked.get("pageToken", 0))
        page = list(entries.items())[begin : begin + _PAGE]
        items = [about(name) for name, is_prefix in page if not is_prefix]
        prefixes = [name for name, is_prefix in page if is_prefix]
        more = {"nextPageToken": str(begin + _PAGE)} if begin + _PAGE < len(entries) else {}
        return {"kind": "storage#objects", "items": items, "prefixes": prefixes, **more}

    def answer(method, path, asked, body):
        found = re.fullmatch(r"/(?:(?:upload|download)/)?storage/v1/b/([^/]+)(/o(?:/(.*))?)?", path)
        if found is None or found[1] != BUCKET:
            return _missing()
        if method == "POST":
            _, head, rest = body.split(b"--==0==", 2)
            name = json.loads(head.split(b"\n\n", 1)[1])["name"]
            objects[name] = rest.split(b"\n\n", 1)[1].removesuffix(b"\n--==0==--")
            return 200, about(name), {}
        if found[3] is None:
            return 200, listed(asked) if found[2] else {"kind": "storage#bucket", "name": BUCKET}, {}
        name = unquote(found[3])
        if name not in objects:
            return _missing()
        if method == "DELETE":
            del objects[name]
            return 200, b"", {}
        return 200, objects[name] if asked.get("alt") == "media" else about(name), {}

    with _server(answer) as address:
        yield address


def _missing():
    reason = {"code": 404, "message": "notFound", "errors": [{"reason": "notFound"}]}
    return 404, {"error": reason}, {}


@contextmanager
def hub_server(files):
    """A data set of the files by their names, as they are whenever it is asked."""

    def about(name):
        date = {"id": _COMMIT, "title": "", "date": _DATE}
        oid = hashlib.sha1(files[name], usedforsecurity=False).hexdigest()
        return {"type": "file", "oid": oid, "size": len(files[name]), "path": name, "lastCommit": date}

    def answer(method, path, asked, body):
        path, text = unquote(path), body.decode()
        if re.fullmatch(rf"/api/{REPOSITORY}(/revision/main)?", path):
            return 200, {"id": "user/set", "sha": _COMMIT, "siblings": []}, {}
        if re.fullmatch(rf"/api/{REPOSITORY}/paths-info/\w+", path):
            names = json.loads(text)["paths"] if text.startswith("{") else parse_qs(text)["paths"]
            return 200, [about(name) for name in names if name in files], {}
        if re.fullmatch(rf"/api/{REPOSITORY}/tree/\w+", path):
            return 200, [about(name) for name in files], {}
        found = re.fullmatch(rf"/{REPOSITORY}/resolve/\w+/(.*)", path)
        if found and found[1] in files:
            return 200, files[found[1]], {"ETag": '"any"', "X-Repo-Commit": _COMMIT}
        return 404, {"error": "none"}, {"X-Error-Code": "EntryNotFound" if found else "RepoNotFound"}

    with _server(answer) as address:
        yield address

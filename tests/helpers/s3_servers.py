"""An S3 server of this machine, and a wire to it that can be slow, cut, busy or closed."""

import socket
import threading
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from urllib.request import Request, urlopen

import pytest

BUCKET = "pictures"


@contextmanager
def s3_server():
    """Moto's server on a free port, empty; yields its address. Skips where moto or s3fs is not installed."""
    pytest.importorskip("s3fs")
    server = pytest.importorskip("moto.server").ThreadedMotoServer(
        ip_address="127.0.0.1", port=0, verbose=False
    )
    server.start()
    host, port = server.get_host_and_port()
    reset = Request(f"http://{host}:{port}/moto-api/reset", method="POST")
    urlopen(reset, timeout=120).close()  # moto's servers of one process hold the same buckets
    try:
        yield f"http://{host}:{port}"
    finally:
        server.stop()


@dataclass
class Wire:
    """A port that leads to a server. Faults by how many requests for ``named`` objects they still hit.

    cut_at: bytes of the answer after which the connection ends. status: answered in place of the server.
    delay_s: before each answer begins. requests: the first line of each that came.
    """

    to: tuple[str, int]
    named: str = ""
    cuts: int = 0
    cut_at: int = 2000
    refusals: int = 0
    status: str = "503 Service Unavailable"
    delay_s: float = 0.0
    requests: list[str] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def mend(self):
        """No faults, and no requests so far."""
        self.named, self.cuts, self.cut_at, self.refusals = "", 0, 2000, 0
        self.status, self.delay_s = "503 Service Unavailable", 0.0
        self.requests.clear()

    def serve(self, client):
        with client, suppress(OSError):
            head = b""
            while b"\r\n\r\n" not in head:
                got = client.recv(65536)
                if not got:
                    return
                head += got
            first = head.split(b"\r\n")[0].decode("latin-1")
            with self._lock:
                self.requests.append(first)
                hit = self.named in first
                refused = hit and self.refusals > 0
                self.refusals -= refused
                cut = hit and not refused and self.cuts > 0 and first.startswith("GET")
                self.cuts -= cut
            if hit and self.delay_s:
                threading.Event().wait(self.delay_s)
            if refused:
                code = "AccessDenied" if self.status.startswith("403") else "ServiceUnavailable"
                body = b"" if first.startswith("HEAD") else f"<Error><Code>{code}</Code></Error>".encode()
                answer = f"HTTP/1.1 {self.status}\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
                client.sendall(answer.encode() + body)
                return
            self._pass_on(client, head, self.cut_at if cut else None)

    def _pass_on(self, client, head, cut_at):
        with socket.create_connection(self.to) as server:
            lines = head.split(b"\r\n")
            kept = [line for line in lines if not line.lower().startswith(b"connection:")]
            server.sendall(b"\r\n".join([kept[0], b"Connection: close", *kept[1:]]))
            threading.Thread(target=_copy, args=(client, server), daemon=True).start()
            sent = 0
            while data := server.recv(65536):
                data = data if cut_at is None else data[: max(cut_at - sent, 0)]
                client.sendall(data)
                sent += len(data)
                if cut_at is not None and sent >= cut_at:
                    break
            client.shutdown(socket.SHUT_RDWR)  # closing alone would wait for the other thread


def _copy(client, server):
    with suppress(OSError):
        while data := client.recv(65536):
            server.sendall(data)


@contextmanager
def wire_to(address):
    """A wire to the server of that address; yields its own address."""
    host, port = address.removeprefix("http://").split(":")
    wire = Wire((host, int(port)))
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def accept():
            with suppress(OSError):
                while True:
                    client, _ = listening.accept()
                    threading.Thread(target=wire.serve, args=(client,), daemon=True).start()

        threading.Thread(target=accept, daemon=True).start()
        yield f"http://127.0.0.1:{listening.getsockname()[1]}", wire


def at(address, set_variable):
    """Lead botocore there, as its environment does, and forget the file systems of servers before."""
    import s3fs

    s3fs.S3FileSystem.clear_instance_cache()
    for name, value in (
        ("AWS_ENDPOINT_URL", address),
        ("AWS_ACCESS_KEY_ID", "testing"),
        ("AWS_SECRET_ACCESS_KEY", "testing"),
        ("AWS_DEFAULT_REGION", "us-east-1"),
        ("AWS_EC2_METADATA_DISABLED", "true"),
    ):
        set_variable(name, value)

"""A stand-in for the Hugging Face Hub: the requests that huggingface_hub makes, on this machine."""

import base64
import hashlib
import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit


class StandIn(ThreadingHTTPServer):
    """A server with repositories in memory.

    Attributes:
        repositories: files of each repository, by name.
        requests: method, path and access token of each request.
        announced: sizes that the list of files names in place of the true ones.
        listed_hashes: hashes that it names in place of the true ones.
        refusal: status that answers every request; None for none.
    """

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), Handler)
        self.repositories: dict[str, dict[str, bytes]] = {}
        self.requests: list[tuple[str, str, str | None]] = []
        self.announced: dict[str, int] = {}
        self.listed_hashes: dict[str, str] = {}
        self.refusal: int | None = None

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(BaseHTTPRequestHandler):
    server: StandIn

    def log_message(self, *_: object) -> None:
        pass

    def do_GET(self) -> None:
        path = self._note()
        if self.server.refusal:
            return self._answer({"error": "refused"}, self.server.refusal)
        user, name, *rest = path.removeprefix("api/models/").split("/")
        files = self.server.repositories.get(f"{user}/{name}")
        if files is None:
            return self._answer({"error": "not found"}, 404, {"X-Error-Code": "RepoNotFound"})
        if path.startswith("api/"):
            return self._answer({"id": f"{user}/{name}", "siblings": self._siblings(files)})
        assert rest[:2] == ["resolve", "main"]
        return self._send(files["/".join(rest[2:])])

    def do_POST(self) -> None:
        path = self._note()
        body = self.rfile.read(int(self.headers["Content-Length"])).decode()
        if self.server.refusal:
            return self._answer({"error": "refused"}, self.server.refusal)
        if path == "api/validate-yaml":
            return self._answer({"errors": [], "warnings": []})
        if path == "api/repos/create":
            asked = json.loads(body)
            repo = f"{asked.get('organization') or 'ann'}/{asked['name']}"
            self.server.repositories.setdefault(repo, {})
            return self._answer({"url": f"{self.server.url}/{repo}", "name": repo})
        _, _, user, name, action, branch = path.split("/")
        assert branch == "main"
        if action == "preupload":
            files = [
                {"path": file["path"], "uploadMode": "regular", "shouldIgnore": False}
                for file in json.loads(body)["files"]
            ]
            return self._answer({"files": files})
        assert action == "commit"
        for line in map(json.loads, body.splitlines()):
            if line["key"] == "file":
                value = line["value"]
                data = base64.b64decode(value["content"])
                self.server.repositories[f"{user}/{name}"][value["path"]] = data
        commit = f"{self.server.url}/{user}/{name}/commit/{'0' * 40}"
        return self._answer({"commitUrl": commit, "commitOid": "0" * 40})

    def _siblings(self, files: dict[str, bytes]) -> list[dict]:
        siblings = []
        for name, data in files.items():
            digest = self.server.listed_hashes.get(name, hashlib.sha256(data).hexdigest())
            lfs = {"sha256": digest, "size": len(data), "pointerSize": 100}
            size = self.server.announced.get(name, len(data))
            siblings.append({"rfilename": name, "size": size, "blobId": "0" * 40, "lfs": lfs})
        return siblings

    def _note(self) -> str:
        path = urlsplit(self.path).path
        self.server.requests.append((self.command, path, self.headers.get("Authorization")))
        return path.removeprefix("/")

    def _answer(self, content: dict, status: int = 200, headers: dict | None = None) -> None:
        self._send(json.dumps(content).encode(), status, headers)

    def _send(self, data: bytes, status: int = 200, headers: dict | None = None) -> None:
        self.send_response(status)
        for name, value in {"Content-Type": "application/json", **(headers or {})}.items():
            self.send_header(name, value)
        self.send_header("Content-Length", str(len(data)))
        self.end_headers()
        self.wfile.write(data)


@contextmanager
def serving() -> Iterator[StandIn]:
    """Serve in a thread of this process."""
    with StandIn() as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.05})
        thread.start()
        try:
            yield server
        finally:
            server.shutdown()
            thread.join()

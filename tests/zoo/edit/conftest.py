"""A page that is served in this process."""

import json
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from datamodules.recording_edits import Edits
from datamodules.recording_format import read_recordings
from tests.recordings import Written
from tests.zoo.page_requests import Answer, ask
from zoo.base.page_server import PageServer
from zoo.checkpoints.policy_base import as_policy
from zoo.server.edit_page import EditPage
from zoo.server.edit_session import EditSession, FrameAnalysis


class ServedPage:
    """A page and its address.

    Args:
        server: server of the page.
        page: page that it serves.
    """

    def __init__(self, server: PageServer, page: EditPage) -> None:
        self.port, self.page = server.server_port, page
        self.url = f"http://127.0.0.1:{self.port}"

    def ask(self, method: str, path: str, body: object = None, **headers: str) -> Answer:
        return ask(self.port, method, path, body, **headers)

    def read(self, path: str) -> dict:
        status, _, body = self.ask("GET", path)
        assert status == 200, body
        return json.loads(body)

    def order(self, shown: str = "", **command: object) -> tuple[int, dict]:
        query = f"?shown={shown}" if shown else ""
        status, _, body = self.ask("POST", f"/command{query}", command)
        return status, json.loads(body)


@pytest.fixture
def served(recorded: Written, tmp_path: Path) -> Iterator[ServedPage]:
    """Yield the page of a recording of 120 rows, with a policy that steers by the image."""
    shutil.copytree(recorded.folder, tmp_path / "lap")
    recording = read_recordings(str(tmp_path / "lap"))
    policy = as_policy(lambda frame, speed: (float(frame.mean()) / 255, None))
    analysis = FrameAnalysis(recording, policy)
    session = EditSession(recording, Edits(len(recording)))
    page = EditPage(session, analysis, "best.ckpt")
    with PageServer(0, page) as server:
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        analysis.start()
        try:
            yield ServedPage(server, page)
        finally:
            server.shutdown()
            thread.join()
            analysis.stop()
            session.finish()

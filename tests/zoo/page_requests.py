"""Requests to a page, as a browser sends them."""

import contextlib
import http.client
import json

Answer = tuple[int, str, bytes]


def ask(port: int, method: str, path: str, body: object = None, **headers: str) -> Answer:
    """Return status, content type and body of an answer.

    A body is JSON, and named so, unless it is bytes.
    """
    is_json = body is not None and not isinstance(body, bytes)
    kind = {"Content-Type": "application/json"} if is_json else {}
    fields = {name.replace("_", "-"): value for name, value in headers.items()}
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=30)
    with contextlib.closing(connection):
        connection.request(method, path, json.dumps(body) if is_json else body, kind | fields)
        answer = connection.getresponse()
        return answer.status, answer.headers["Content-Type"], answer.read()

"""Fixtures of the tests of corrections."""

from tests.hostile.conftest import refusal  # noqa: F401

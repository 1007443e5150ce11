"""Version of the installed package."""

from importlib.metadata import PackageNotFoundError, version

FLAGS = ("--version", "-V")


def version_line() -> str:
    """Return the package's version with those of Python and PyTorch, without importing it."""
    import platform

    return f"drivezoo {_of('drivezoo')} (Python {platform.python_version()}, torch {_of('torch')})"


def _of(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:  # a checkout on the path, without an installation
        return "not installed"

"""Large files of images, shards, that are fetched and decoded while a training walks over them."""

from abc import ABC, abstractmethod

from datamodules.image import Stored, StoredImage


class ImageStore(ABC):
    """A reader of the images in shards; a format of such files has a subclass.

    Attributes:
        images: number of images of each shard, by name.
        bytes: size of each shard, by name.
        is_remote: whether shards are fetched from another machine.
        remedy: what to do about a damaged shard, for messages.
    """

    images: dict[str, int]
    bytes: dict[str, int]
    is_remote: bool
    remedy: str

    @abstractmethod
    def __call__(self, file: str, number: int) -> Stored:
        """Return the JPEG or PNG at a position of a shard.

        Raises:
            OSError, ValueError: the shard is missing or damaged.
            InputError: a server does not answer.
        """

    @abstractmethod
    def fetch_ahead(self, names: list[str]) -> None:
        """Fetch shards in a thread; a failure is reported by the reader that needs the shard."""


def shard_of(image: object) -> tuple[str, ImageStore] | None:
    """Return the place of an image's shard, and its store; None for an image elsewhere."""
    if isinstance(image, StoredImage) and isinstance(image.reader, ImageStore):
        return image.file, image.reader
    return None

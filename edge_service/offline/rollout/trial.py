"""A new configuration checked as the service would check it, without being put in place."""

import tempfile
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any

from ...config import ConfigError
from ..configuration import CheckedConfiguration, check_configuration
from .contents import RolloutError
from .toml_text import flat


def check_new(config: Path, files: Mapping[str, bytes], governed: set[str]) -> CheckedConfiguration:
    """Check files as if they were in place, beside all others that are there already.

    Args:
        config: where the configuration will lie.
        files: new content by name relative to its folder, the configuration among them.
        governed: names that an earlier bundle put there, and that go unless they are new too.

    Raises:
        RolloutError: the service would refuse them.
    """
    with tempfile.TemporaryDirectory(prefix="edge-service-") as scratch:
        levels = _levels_up(flat(files[config.name], config.name))
        folder = _likeness(Path(scratch), config.parent.resolve(), levels)
        _furnish(folder, config.parent.resolve(), PurePosixPath(), files, governed)
        try:
            checked = check_configuration(folder / config.name).document
        except ConfigError as error:
            words = str(error).replace(f"{folder}/", "")
            raise RolloutError(f"the new configuration is refused: {words}") from None
    assert isinstance(checked, CheckedConfiguration)
    return checked


def _levels_up(values: Mapping[str, Any]) -> int:
    """Number of folders above that of the configuration that a path in it leads up."""
    texts = [value for value in values.values() if isinstance(value, str)]
    return max((PurePosixPath(text).parts.count("..") for text in texts), default=0)


def _likeness(scratch: Path, folder: Path, levels: int) -> Path:
    """An empty folder that has the same neighbours, as many levels up as needed."""
    chain = [folder, *folder.parents][: levels + 1]
    place = scratch
    for above, below in zip(reversed(chain[1:]), reversed(chain[:-1]), strict=True):
        for each in above.iterdir():
            if each.name != below.name:
                (place / each.name).symlink_to(each)
        place /= below.name
        place.mkdir()
    if place == scratch:
        place /= "configuration"
        place.mkdir()
    return place


def _furnish(
    place: Path, real: Path, within: PurePosixPath, files: Mapping[str, bytes], governed: set[str]
) -> None:
    """Write the new files into a folder, and link to all else that lies there."""
    names = [PurePosixPath(name) for name in files]
    names = [name for name in names if name.parent.is_relative_to(within)]
    deeper = {name.relative_to(within).parts[0] for name in names if name.parent != within}
    new = {name.name: files[str(name)] for name in names if name.parent == within}
    for each in real.iterdir() if real.is_dir() else ():
        if each.name not in deeper | set(new) and str(within / each.name) not in governed:
            (place / each.name).symlink_to(each)
    for name, content in new.items():
        (place / name).write_bytes(content)
    for name in deeper:
        (place / name).mkdir()
        _furnish(place / name, real / name, within / name, files, governed)

"""Open a rosbag2 and read its messages, one at a time."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rvsg.core.errors import FileError
from rvsg_exchange.ros_types import rosbags_types


@contextmanager
def open_bag(path: Path) -> Iterator[Any]:
    """Open a rosbag2 (a folder, or one `.mcap` or `.db3` file) for reading; FileError where it is none."""
    types = rosbags_types()
    from rosbags.highlevel import AnyReader

    if not path.exists():
        raise FileError(path, "the recording does not exist.")
    try:
        reader = AnyReader([path], default_typestore=types)
        reader.open()
    except Exception as error:  # whatever the library raises on a file that is no bag
        said = f"this is no recording that rosbags can read ({_reason(error)})."
        raise FileError(
            path, f"{said} One that was cut off is repaired by `mcap recover` or `ros2 bag reindex`."
        ) from error
    try:
        yield reader
    finally:
        reader.close()


def bag_messages(reader: Any, path: Path, topics: Collection[str]) -> Iterator[tuple[Any, float, Any]]:
    """Yield connection, time of receipt (s) and message of the topics, in order; FileError where the bag is damaged."""
    chosen = [connection for connection in reader.connections if connection.topic in topics]
    stream = iter(reader.messages(connections=chosen)) if chosen else iter(())
    while True:
        try:
            connection, stamp, raw = next(stream)
            message = reader.deserialize(raw, connection.msgtype)
        except StopIteration:
            return
        except Exception as error:  # whatever the library raises on damaged data
            raise FileError(path, f"the recording is damaged ({_reason(error)}).") from error
        yield connection, stamp / 1e9, message


def _reason(error: Exception) -> str:
    return f"{type(error).__name__}: {error}" if str(error) else type(error).__name__

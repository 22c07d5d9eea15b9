"""A log of a stream in a rosbag2 folder, as ROS 2 Jazzy and later read it.

What has been written lies in the storage file at most FLUSH_S after the first record of it came. The folder's
metadata.yaml is written at the end: after a kill the storage file is there without it.
"""

import shutil
import time
from pathlib import Path
from typing import Literal

from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

from fastac.streaming.record import StreamRecord
from fastac.streaming.ros import cdr, qos
from fastac.streaming.ros.log_files import FLUSH_S, checked, described, name_in, refuse_existing
from fastac.streaming.ros.messages import Messages
from fastac.streaming.ros.topics import NAMESPACE

STORAGES = {"mcap": StoragePlugin.MCAP, "sqlite3": StoragePlugin.SQLITE3}


class Rosbag2Sink:
    """Writes every record's messages, with the source's time stamp as the time of the log.

    storage : "mcap" or "sqlite3"
    Raises LogError where the folder exists already, unless `force` and it holds a log and nothing else, and
    for a namespace that is none.
    """

    def __init__(
        self,
        folder: Path,
        messages: Messages,
        *,
        storage: Literal["mcap", "sqlite3"] = "mcap",
        namespace: str = NAMESPACE,
        force: bool = False,
    ) -> None:
        checked(namespace)
        refuse_existing(folder, force=force)
        if folder.exists():
            shutil.rmtree(folder)
        self._messages = messages
        self._writer = Writer(folder, version=Writer.VERSION_LATEST, storage_plugin=STORAGES[storage])
        for key, value in described(messages, namespace).items():
            self._writer.set_custom_data(key, value)
        self._writer.open()
        self._connections = {
            topic.name: self._writer.add_connection(
                name_in(namespace, topic),
                topic.type,
                typestore=cdr.typestore(),
                offered_qos_profiles=[qos.OFFERED],
            )
            for topic in messages.topics
        }
        self._flushed = time.monotonic()

    def add(self, record: StreamRecord) -> None:
        for message in self._messages.of(record):
            connection = self._connections[message.topic.name]
            self._writer.write(connection, record.source_time_ns, cdr.serialised(message))
        if time.monotonic() - self._flushed > FLUSH_S:
            self._flush()
            self._flushed = time.monotonic()

    def _flush(self) -> None:
        """Put what was written into the file. The writer itself does so for sqlite3 at the end only."""
        storage = self._writer.storage
        if isinstance(storage, McapWriter):
            if storage.chunk.bio.tell():
                storage.close_chunk()
            storage.bio.flush()
        else:
            storage.conn.commit()

    def close(self) -> None:
        """Write what is left, the index and the folder's metadata.yaml."""
        self._writer.close()

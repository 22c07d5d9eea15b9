"""A log of a stream in one MCAP file, with ROS 2 messages: for `ros2 bag play` and for viewers.

The file is written in chunks, each at most FLUSH_S after the first record in it. After a kill the chunks that
were written can be read, by readers that do not ask for the index at the file's end.
"""

import time
from pathlib import Path
from typing import Literal

from mcap.well_known import MessageEncoding, Profile, SchemaEncoding
from mcap.writer import CompressionType, Writer

from fastac.streaming.record import StreamRecord
from fastac.streaming.ros import cdr, qos
from fastac.streaming.ros.log_files import FLUSH_S, checked, described, name_in, refuse_existing
from fastac.streaming.ros.messages import Messages
from fastac.streaming.ros.topics import NAMESPACE

METADATA = "fastac"
"""Name of the metadata record that describes the stream."""


COMPRESSIONS = {kind.name.lower(): kind for kind in CompressionType}


class McapSink:
    """Writes every record's messages, with the source's time stamp as the time of the log.

    compression : "zstd", "lz4" or "none"
    Raises LogError where the file exists already, unless `force`, and for a namespace that is none.
    """

    def __init__(
        self,
        path: Path,
        messages: Messages,
        *,
        compression: Literal["zstd", "lz4", "none"] = "zstd",
        namespace: str = NAMESPACE,
        force: bool = False,
    ) -> None:
        checked(namespace)
        refuse_existing(path, force=force)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._messages = messages
        self._file = path.open("wb")
        self._writer = Writer(self._file, compression=COMPRESSIONS[compression])
        self._writer.start(profile=Profile.ROS2)
        self._writer.add_metadata(METADATA, described(messages, namespace))
        schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        for topic in messages.topics:
            text, digest = cdr.definition(topic.type)
            if topic.type not in schemas:
                schemas[topic.type] = self._writer.register_schema(
                    topic.type, SchemaEncoding.ROS2, text.encode()
                )
            self._channels[topic.name] = self._writer.register_channel(
                name_in(namespace, topic),
                MessageEncoding.CDR,
                schemas[topic.type],
                {"offered_qos_profiles": qos.offered(), "topic_type_hash": digest, "unit": topic.unit},
            )
        self._flushed = time.monotonic()

    def add(self, record: StreamRecord) -> None:
        for message in self._messages.of(record):
            self._writer.add_message(
                self._channels[message.topic.name],
                log_time=record.source_time_ns,
                publish_time=record.source_time_ns,
                sequence=record.frame,
                data=cdr.serialised(message),
            )
        if time.monotonic() - self._flushed > FLUSH_S:
            self._writer.flush()
            self._flushed = time.monotonic()

    def close(self) -> None:
        """Write what is left and the index."""
        self._writer.finish()
        self._file.close()

"""MCAP logs: channels in JSON, protobuf or ROS 2's CDR, as columns ``<topic>.<field>[<joint>]`` (see ``messages.py``).

The records are read one after the other, without the index, so that a log whose writer was killed is refused rather
than half read. No chunk is unpacked beyond the size it declares, and none may declare more than ``LARGEST``.
Source of the format: https://mcap.dev/spec. Needs the extra ``mcap``.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path
from typing import Any, BinaryIO

from onlinebayes.measurements.formats.cdr import MISSING, Decoder, cdr_decoder
from onlinebayes.measurements.formats.messages import record
from onlinebayes.measurements.formats.series import Recorder, SeriesSource
from onlinebayes.runs import BadInput

LARGEST = 256 * 2**20
"""Bytes of one record or one unpacked chunk; writers make chunks of a few MB."""

MOST_UNPACKED = 16 * 2**30
"""Bytes of all chunks unpacked: a tiny file of many bombs would take hours."""


def mcap_source(path: Path) -> SeriesSource:
    """The numbers of an MCAP file.

    Raises:
        BadInput: it is damaged or cut short, unpacks to far too much, has no channel in JSON, protobuf or CDR, or the
            extra is missing.
    """
    recorder = Recorder(path)
    unreadable = read_mcap(path, recorder)
    if not recorder.series:
        seen = ", ".join(sorted(unreadable))[:200]
        raise BadInput(
            f"no channel holds numbers in JSON, protobuf or CDR{f' (there are {seen})' if seen else ''}",
            f"for CDR {MISSING}" if "cdr" in unreadable else "record such a channel, or write a CSV table",
            where=str(path),
        )
    return SeriesSource(path, recorder.tied())


def read_mcap(path: Path, recorder: Recorder) -> set[str]:
    """Record every message of a file; returns the encodings that were left out.

    Raises:
        BadInput: see :func:`mcap_source`.
    """
    try:
        return _read(path, recorder)
    except BadInput:
        raise
    except Exception as error:  # damaged bytes raise whatever the record, JSON, protobuf or CDR parser meets first
        problem = f"is a damaged MCAP file: {type(error).__name__} {str(error)[:200]}"
        raise BadInput(problem, "record it again, or mend it with 'mcap recover'", where=str(path)) from None


def _read(path: Path, recorder: Recorder) -> set[str]:
    """Record every message; returns the encodings that were left out."""
    records, protobuf = _library(path)
    schemas: dict[int, Any] = {}
    channels: dict[int, Any] = {}
    decoders: dict[int, Decoder | None] = {}
    with closing(path.open("rb")) as file:
        for one in _records(file, path):
            if isinstance(one, records.Schema):
                schemas[one.id] = one
            elif isinstance(one, records.Channel):
                channels[one.id] = one
            elif isinstance(one, records.Message):
                channel = channels[one.channel_id]
                if one.channel_id not in decoders:
                    decoders[one.channel_id] = _decoder(channel, schemas, protobuf)
                if (decode := decoders[one.channel_id]) is not None:
                    record(recorder, channel.topic, decode(one.data), one.log_time)
    return {channels[number].message_encoding for number, decode in decoders.items() if decode is None}


def _library(path: Path) -> tuple[Any, Any]:
    try:
        from mcap import records
        from mcap_protobuf.decoder import DecoderFactory
    except ImportError:
        raise BadInput(
            "reading MCAP needs mcap and mcap-protobuf-support",
            "install the extra mcap (pip install -e '.[mcap]' in the repository), or save the log as CSV",
            where=str(path),
        ) from None
    return records, DecoderFactory()


def _decoder(channel: Any, schemas: dict[int, Any], protobuf: Any) -> Decoder | None:
    if channel.message_encoding == "json":
        return json.loads
    schema = schemas.get(channel.schema_id)
    if channel.message_encoding == "cdr":
        with suppress(ImportError):  # other channels can be read without
            return None if schema is None else cdr_decoder(schema.name, schema.data.decode(), schema.encoding)
        return None
    decode = protobuf.decoder_for(channel.message_encoding, schema)
    return None if decode is None else lambda data: _plain(decode(data))


def _plain(message: Any) -> dict[str, Any]:
    """A protobuf message as mappings, lists and numbers; bytes, texts and maps are left out."""
    plain: dict[str, Any] = {}
    for field, value in ((field, getattr(message, field.name)) for field in message.DESCRIPTOR.fields):
        single = isinstance(value, bool | int | float) or hasattr(value, "DESCRIPTOR")
        if single:
            if field.message_type is None:
                plain[field.name] = value
            elif message.HasField(field.name):
                plain[field.name] = _plain(value)
        elif field.message_type is None and not isinstance(value, str | bytes):
            plain[field.name] = list(value)
    return plain


class _Bounded:
    """A file that is never asked for more than it has: the library reads whatever length a record claims."""

    def __init__(self, file: BinaryIO, size: int) -> None:
        self._file, self._most = file, min(size, LARGEST)

    def read(self, length: int) -> bytes:
        return self._file.read(min(length, self._most))


def _records(file: BinaryIO, path: Path) -> Iterator[Any]:
    """The records of the data section, chunks unpacked; the library's own loop would unpack them without a bound."""
    from mcap.records import Chunk
    from mcap.stream_reader import StreamReader, breakup_chunk

    total, size = 0, path.stat().st_size
    bounded: Any = _Bounded(file, size)
    for one in StreamReader(bounded, emit_chunks=True, record_size_limit=min(LARGEST, size)).records:
        if not isinstance(one, Chunk):
            yield one
            continue
        total += one.uncompressed_size
        if one.uncompressed_size > LARGEST or total > MOST_UNPACKED:
            raise BadInput(
                f"a chunk unpacks to {one.uncompressed_size} bytes ({total} in all)",
                f"record chunks of at most {LARGEST} bytes",
                where=str(path),
            )
        one.data, one.compression = _unpacked(one, path), ""
        yield from breakup_chunk(one, validate_crc=True)


def _unpacked(chunk: Any, path: Path) -> bytes:
    """The chunk's bytes, reading at most one more than it declares."""
    most = chunk.uncompressed_size + 1
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        import zstandard

        with zstandard.ZstdDecompressor(max_window_size=LARGEST).stream_reader(chunk.data) as stream:
            data = stream.read(most)
    elif chunk.compression == "lz4":
        import lz4.frame

        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=most)
    else:
        problem = f"a chunk is packed as '{chunk.compression[:40]}'"
        raise BadInput(problem, "record with zstd, lz4 or no compression", where=str(path))
    if len(data) != chunk.uncompressed_size:
        raise BadInput(
            f"a chunk unpacks to another size than the {chunk.uncompressed_size} bytes it declares",
            "the file is damaged: record it again",
            where=str(path),
        )
    return data

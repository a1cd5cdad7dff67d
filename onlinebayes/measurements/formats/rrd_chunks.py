"""A program of its own: the chunks of a Rerun recording on standard output, each an Arrow stream with its entity path.

Rerun's reader ends the whole process where damaged bytes make it panic (``SIGABRT``, in rerun-sdk 0.41 for one changed
byte in a few hundred). Here it ends nothing but this program; :mod:`.rrd` starts it and reads what it writes.
"""

from __future__ import annotations

import sys
import warnings

ENTITY = b"onlinebayes:entity"
"""Key of the entity path in the metadata of a stream's schema."""
UNREADABLE = 3
"""Exit status where the reader says what is wrong, on standard error."""


def main(path: str) -> int:
    """Write the chunks that are not static; returns the exit status."""
    import pyarrow as pa
    from rerun.chunk import RrdReader

    warnings.simplefilter("ignore")  # a recording that was cut at a chunk's end has no manifest: no harm
    try:
        chunks = [chunk for chunk in RrdReader(path).stream().to_chunks() if not chunk.is_static]
        batches = [(chunk.entity_path, chunk.to_record_batch()) for chunk in chunks]
    except Exception as error:  # RuntimeError of the Rust reader, Arrow's where the bytes are no table
        print(error, file=sys.stderr)
        return UNREADABLE
    for entity, batch in batches:
        schema = batch.schema.with_metadata({**(batch.schema.metadata or {}), ENTITY: entity.encode()})
        with pa.ipc.new_stream(sys.stdout.buffer, schema) as stream:
            stream.write_batch(batch.cast(schema))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))

"""What HDF5 files declare, checked before it is read: sizes, links, and where the data would come from.

The HDF5 library trusts a file. One that was damaged, or made to do harm, can make it loop for ever, allocate
whatever is declared, or read other files; each check here stands for one of these.
"""

import mmap
import struct
from math import ceil, prod
from pathlib import Path

import h5py

MAX_RATIOS = {h5py.h5z.FILTER_DEFLATE: 1032, h5py.h5z.FILTER_LZF: 88}
"""By filter that compresses: most bytes that one stored byte can become."""
OTHER_FILTERS = (h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32)
BYTES_PER_CHUNK = 8
"""A file has at least so many bytes for each chunk: its address in the index, or its content."""
MAX_ATTRIBUTE_BYTES = 65536
TYPES = (h5py.h5t.TypeIntegerID, h5py.h5t.TypeFloatID, h5py.h5t.TypeEnumID, h5py.h5t.TypeStringID)
TEXT_BYTES = 16
"""A text of any length in a file: its length in 4 bytes, then where it is."""
HEAP = b"GCOL\x01"
HEAP_MINIMUM = 4096
HEAP_HEADER, OBJECT_HEADER = 16, 16
"""Bytes before a global heap's first object, and before each object's content."""


class UnsafeFileError(ValueError):
    """Something in a file that is not to be read; the message is one line that names key and value."""


def check_heaps(path: Path) -> None:
    """Raise UnsafeFileError where a global heap, which holds texts, declares objects that do not fit into it.

    The library walks from object to object by their sizes, and never ends at free space of 0 bytes.
    """
    if not path.stat().st_size:
        return
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        at = content.find(HEAP)
        while at >= 0:
            _check_heap(content, at)
            at = content.find(HEAP, at + 1)


def _check_heap(content: mmap.mmap, at: int) -> None:
    if at + HEAP_HEADER > len(content):
        return
    *reserved, size = struct.unpack_from("<3BQ", content, at + len(HEAP))
    end, place = at + size, at + HEAP_HEADER
    if size < HEAP_MINIMUM or (end > len(content) and any(reserved)):
        return  # no heap for the library either, but data that happen to begin like one
    if end > len(content):
        raise UnsafeFileError(f"heap at byte {at} = {size} bytes: the file ends before")
    while place + OBJECT_HEADER <= end:
        index, _, _, size = struct.unpack_from("<HHIQ", content, place)
        taken = size if index == 0 else OBJECT_HEADER + ceil(size / 8) * 8
        if not 0 < taken <= end - place:
            raise UnsafeFileError(f"heap at byte {at}: object {index} = {size} bytes: does not fit into it")
        place += taken


def check_link(group: h5py.Group, key: str) -> None:
    """Raise UnsafeFileError for a link to anything but an object of this file that has one name only."""
    link = group.get(key, getlink=True)
    if not isinstance(link, h5py.HardLink):
        raise UnsafeFileError(f"{key}: a link to another place: expected the data itself")


def check_attribute(attributes: h5py.AttributeManager, key: str, path: Path) -> None:
    """Raise UnsafeFileError for an attribute that is no single number or text of sane size."""
    found = attributes.get_id(key)
    kind = found.get_type()
    size = max(found.get_storage_size(), kind.get_size())
    if found.shape != () or size > MAX_ATTRIBUTE_BYTES:
        raise UnsafeFileError(f"{key}: {size} bytes, shape {found.shape}: expected one value")
    _check_type(kind, key)
    if _is_variable(kind):
        _check_lengths(_stored_attribute(path, key), path.stat().st_size, key)


def _is_variable(kind: h5py.h5t.TypeID) -> bool:
    return isinstance(kind, h5py.h5t.TypeStringID) and kind.is_variable_str()


def _check_type(kind: h5py.h5t.TypeID, key: str) -> None:
    """Numbers, Booleans and texts only: with damaged types of other kinds the library reads at random.

    Texts of any length have characters of one byte: memory is cleared by the size that is declared.
    """
    if not isinstance(kind, TYPES):
        raise UnsafeFileError(f"{key}: {type(kind).__name__}: expected numbers or texts")
    if _is_variable(kind) and kind.get_super().get_size() != 1:
        raise UnsafeFileError(f"{key}: characters of {kind.get_super().get_size()} bytes: expected 1")


def _stored_attribute(path: Path, key: str) -> bytes:
    """What a file has of the text attribute `key`: its length and where it is; nothing where that is unknown.

    An attribute is stored as version, flags, the sizes of name, type and space, these three, and the value;
    in version 1 each of the three is padded to 8 bytes, in version 3 a byte for the name's encoding is first.
    """
    name = key.encode() + b"\0"
    with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
        at = content.find(name)
        while at >= 9:
            for version, head in ((1, 8), (2, 8), (3, 9)):
                stated, _, *sizes = struct.unpack_from("<BBHHH", content, at - head)
                if (stated, sizes[0]) == (version, len(name)):
                    padded = [ceil(size / 8) * 8 if version == 1 else size for size in sizes]
                    place = at + sum(padded)
                    return content[place : place + TEXT_BYTES]
            at = content.find(name, at + 1)
    return b""


def _check_lengths(stored: bytes, file_bytes: int, key: str) -> None:
    """Raise UnsafeFileError for texts longer than their file: the library clears memory of their length."""
    for at in range(0, len(stored) - TEXT_BYTES + 1, TEXT_BYTES):
        (length,) = struct.unpack_from("<I", stored, at)
        if length > file_bytes:
            raise UnsafeFileError(f"{key}: a text of {length} bytes: the file has {file_bytes}")


def _stored_texts(stored: h5py.Dataset, key: str, path: Path) -> bytes:
    """What a file has of an array of texts: their lengths and where they are."""
    if stored.chunks:
        if stored.compression or stored.shuffle or stored.fletcher32:
            raise UnsafeFileError(f"{key}: texts that pass filters: expected them as they are")
        chunks = map(stored.id.get_chunk_info, range(stored.id.get_num_chunks()))
        parts = [(chunk.byte_offset, chunk.size) for chunk in chunks]
    else:
        parts = [(stored.id.get_offset(), stored.id.get_storage_size())]
    found = b""
    with path.open("rb") as file:
        for offset, size in parts:
            if offset is not None:
                file.seek(offset)
                found += file.read(min(size, path.stat().st_size))
    return found


def check_array(stored: h5py.Dataset, key: str, path: Path) -> None:
    """Raise UnsafeFileError unless an array's data are in its own file, and can be as large as declared."""
    file_bytes = path.stat().st_size
    plan, kind = stored.id.get_create_plist(), stored.id.get_type()
    if plan.get_layout() == h5py.h5d.VIRTUAL or plan.get_external_count():
        raise UnsafeFileError(f"{key}: its data are in other files: expected them in this one")
    _check_type(kind, key)
    filters = [plan.get_filter(k)[0] for k in range(plan.get_nfilters())]
    for code in filters:
        if code not in MAX_RATIOS and code not in OTHER_FILTERS:
            raise UnsafeFileError(f"{key}: filter {code}: expected gzip, lzf, shuffle or fletcher32")
    ratio = prod(MAX_RATIOS.get(code, 1) for code in set(filters))
    room = ratio * min(stored.id.get_storage_size(), file_bytes)
    declared = prod(stored.shape or ()) * kind.get_size()
    chunk = prod(stored.chunks or (1,)) * kind.get_size()
    if declared > room or chunk > room:
        raise UnsafeFileError(
            f"{key} = {stored.shape} of {stored.dtype}: more than its {file_bytes} bytes can hold"
        )
    if stored.chunks:
        chunks = prod(ceil(size / step) for size, step in zip(stored.shape, stored.chunks, strict=True))
        if chunks > file_bytes // BYTES_PER_CHUNK:
            raise UnsafeFileError(f"{key}: {chunks} chunks: more than its {file_bytes} bytes can hold")
    if _is_variable(kind):
        _check_lengths(_stored_texts(stored, key, path), file_bytes, key)

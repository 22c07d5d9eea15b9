"""What an HDF5 file declares, refused before the library acts on it."""

import struct

import h5py
import numpy as np
import pytest

from fastac.sensor import dataset
from fastac.sensor.dataset import DatasetError

COUNT, SIZE = 3, 8


@pytest.fixture
def path(tmp_path):
    """A whole dataset, to be damaged."""
    found = tmp_path / "data.h5"
    frames = np.zeros((COUNT, SIZE, SIZE, 3), np.uint8)
    split, force = np.array(["train", "train", "test"]), np.ones((COUNT, 3))
    given = {"pitch_mm": 0.1, "channels": ("B", "G", "R"), "source": "simulated", "background": frames[0]}
    dataset.write(found, **given, split=split, frames=frames, force_n=force, group=np.array(["a", "b", "c"]))
    assert len(dataset.read(found)) == COUNT
    return found


def refused(path, match: str) -> None:
    with pytest.raises(DatasetError, match=match) as caught:
        dataset.read(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def overwrite(path, at: int, content: bytes) -> None:
    whole = bytearray(path.read_bytes())
    whole[at : at + len(content)] = content
    path.write_bytes(whole)


class TestHeaps:
    """The library walks through a heap by the sizes in it; free space of 0 bytes has no end."""

    def free_space(self, path) -> int:
        """Where the first heap's free space begins."""
        whole = path.read_bytes()
        at = whole.index(b"GCOL\x01") + 16
        while (found := struct.unpack_from("<HHIQ", whole, at))[0]:
            at += 16 + -(-found[3] // 8) * 8
        return at

    @pytest.mark.parametrize("size", [0, 2**64 - 16, 2**40])
    def test_free_space_that_does_not_fit(self, path, size):
        overwrite(path, self.free_space(path) + 8, struct.pack("<Q", size))
        refused(path, rf"damaged: heap at byte \d+: object 0 = {size} bytes: does not fit into it")

    @pytest.mark.parametrize("size", [2**64 - 16, 2**20])
    def test_an_object_that_does_not_fit(self, path, size):
        overwrite(path, path.read_bytes().index(b"GCOL\x01") + 16 + 8, struct.pack("<Q", size))
        refused(path, rf"object 1 = {size} bytes: does not fit into it")

    def test_a_heap_beyond_the_file(self, path):
        overwrite(path, path.read_bytes().index(b"GCOL\x01") + 8, struct.pack("<Q", 2**40))
        refused(path, r"heap at byte \d+ = 1099511627776 bytes: the file ends before")

    def test_data_that_happen_to_begin_like_a_heap(self, path):
        """Pixels may have any values."""
        with h5py.File(path, "r+") as file:
            del file["background"]
            pixels = np.zeros((SIZE, SIZE, 3), np.uint8)
            pixels.flat[:8] = list(b"GCOL\x01abc")
            pixels.flat[40:48] = list(b"GCOL\x01\0\0\0")
            pixels.flat[8:16] = pixels.flat[100:108] = 255
            file["background"] = pixels
        assert path.read_bytes().count(b"GCOL\x01") == 3
        np.testing.assert_array_equal(dataset.read(path).background, pixels)

    def test_an_empty_file(self, path):
        path.write_bytes(b"")
        refused(path, "not an HDF5 file")


class TestTexts:
    """Memory of a text's length is cleared before the text is looked for."""

    @pytest.mark.parametrize("chunked", [False, True])
    def test_longer_than_the_file(self, path, chunked):
        with h5py.File(path, "r+") as file:
            if chunked:
                del file["split"]
                texts = ["train", "train", "test"]
                file.create_dataset("split", data=texts, dtype=h5py.string_dtype(), chunks=(2,))
                at = file["split"].id.get_chunk_info(1).byte_offset
            else:
                at = file["split"].id.get_offset() + 16
        overwrite(path, at, struct.pack("<I", 2**31))
        refused(path, r"split: a text of 2147483648 bytes: the file has \d+")

    def test_an_attribute_longer_than_the_file(self, path):
        whole = path.read_bytes()
        at = whole.index(struct.pack("<I", len("simulated")), whole.index(b"source\0"))
        overwrite(path, at, struct.pack("<I", 2**32 - 1))
        refused(path, r"source: a text of 4294967295 bytes: the file has \d+")

    def test_that_pass_filters(self, path):
        with h5py.File(path, "r+") as file:
            del file["split"]
            texts = ["train", "train", "test"]
            file.create_dataset("split", data=texts, dtype=h5py.string_dtype(), compression="gzip")
        refused(path, "split: texts that pass filters: expected them as they are")

    def test_of_a_type_that_the_library_trips_over(self, path):
        """Such a type ended in a segmentation fault."""
        whole = path.read_bytes()
        kind = whole.index(b"\x19\x01", whole.index(b"source\0"))
        overwrite(path, kind + 1, b"\x15")
        refused(path, "source: TypeVlenID: expected numbers or texts")

    @pytest.mark.parametrize("text", ["two\nlines", "\x1b[2J", b"\xff\xfe"])
    def test_attributes_that_no_line_can_show(self, path, text):
        with h5py.File(path, "r+") as file:
            file.attrs["source"] = text
        refused(path, "source")


class TestPlaces:
    """The data of a dataset are in its own file."""

    @pytest.mark.parametrize(
        "link", [h5py.SoftLink("/frames"), h5py.ExternalLink("other.h5", "/frames")], ids=["soft", "external"]
    )
    def test_links(self, path, link):
        with h5py.File(path, "r+") as file:
            file["frames"].parent.move("frames", "normals")
            file["frames"] = link
        refused(path, "frames: a link to another place")

    def test_links_to_poses(self, path):
        with h5py.File(path, "r+") as file:
            file.create_group("indenter")["x_mm"] = h5py.ExternalLink("other.h5", "/x")
        refused(path, "x_mm: a link to another place")

    def test_data_stored_in_another_file(self, path):
        with h5py.File(path, "r+") as file:
            del file["background"]
            given = {"shape": (SIZE, SIZE, 3), "dtype": np.uint8}
            file.create_dataset("background", **given, external=[(b"/etc/hostname", 0, SIZE * SIZE * 3)])
        refused(path, "background: its data are in other files")

    def test_virtual_arrays(self, path):
        with h5py.File(path, "r+") as file:
            shape = file["frames"].shape
            del file["frames"]
            layout = h5py.VirtualLayout(shape, np.uint8)
            layout[...] = h5py.VirtualSource("other.h5", "frames", shape)
            file.create_virtual_dataset("frames", layout)
        refused(path, "frames: its data are in other files")


class TestSizes:
    @pytest.mark.parametrize("packed", [{}, {"compression": "gzip"}, {"compression": "lzf", "shuffle": True}])
    def test_more_than_the_file_can_hold(self, path, packed):
        with h5py.File(path, "r+") as file:
            del file["frames"]
            file.create_dataset("frames", shape=(10**6, 512, 512, 3), dtype=np.uint8, **packed)
        refused(path, r"frames = \(1000000, 512, 512, 3\) of uint8: more than its \d+ bytes can hold")

    def test_more_chunks_than_the_file_can_hold(self, path):
        with h5py.File(path, "r+") as file:
            del file["frames"]
            given = {
                "shape": (3, 64, 64, 3),
                "dtype": np.uint8,
                "chunks": (1, 1, 1, 1),
                "compression": "gzip",
            }
            frames = file.create_dataset("frames", **given)
            frames[0, :6, :6] = 1
        refused(path, r"frames: 36864 chunks: more than its \d+ bytes can hold")

    def test_a_large_attribute(self, path):
        with h5py.File(path, "r+") as file:
            file.attrs["pitch_mm"] = np.zeros(100)
        refused(path, r"pitch_mm: .* shape \(100,\): expected one value")

    def test_what_can_be_compressed_most_is_read(self, path):
        """A file of zeros, at the ratios of both compressors."""
        for packed in ({"compression": "gzip"}, {"compression": "lzf", "shuffle": True}):
            with h5py.File(path, "r+") as file:
                del file["frames"], file["background"]
                frames = np.zeros((COUNT, 256, 256, 3), np.uint8)
                file.create_dataset("frames", data=frames, chunks=(1, 256, 256, 3), **packed)
                file["background"] = frames[0]
            assert dataset.read(path).frames.shape == (COUNT, 256, 256, 3)

    def test_a_filter_that_is_not_known(self, path):
        with h5py.File(path, "r+") as file:
            del file["force_n"]
            file.create_dataset("force_n", data=np.ones((COUNT, 3), np.float32), scaleoffset=2)
        refused(path, "force_n: filter 6: expected gzip, lzf, shuffle or fletcher32")

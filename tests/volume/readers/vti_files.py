"""VTK image files in every encoding."""

from __future__ import annotations

import base64
import zlib

import numpy as np

SAMPLES = np.random.default_rng(4).normal(size=(3, 4, 5)).astype(np.float32)
BLOCK = 64  # bytes per compressed block: 240 bytes make 4 blocks, the last of 48


def payload(data: bytes, word: str, *, compressed: bool) -> tuple[bytes, bytes]:
    """Header and body of a data block, as VTK writes them."""
    if not compressed:
        return np.array([len(data)], word).tobytes(), data
    blocks = [zlib.compress(data[i : i + BLOCK]) for i in range(0, len(data), BLOCK)]
    last = len(data) % BLOCK
    return np.array([len(blocks), BLOCK, last, *map(len, blocks)], word).tobytes(), b"".join(blocks)


def vti(
    form: str,
    *,
    samples: np.ndarray = SAMPLES,
    order: str = "<",
    word: str = "u4",
    compressed: bool = False,
    attributes: str = "",
    array_attributes: str = "",
    split_groups: bool = False,
) -> bytes:
    """Bytes of a .vti file; `form` is ascii, binary, raw or base64 (the last two appended)."""
    z, y, x = samples.shape[:3]
    vtk_type = {"f": "Float", "u": "UInt", "i": "Int"}[samples.dtype.kind] + str(8 * samples.dtype.itemsize)
    data = samples.astype(order + samples.dtype.str[1:]).tobytes()
    header, body = payload(data, order + word, compressed=compressed)
    groups = compressed or split_groups  # the header is a base64 group of its own when compressed
    text = base64.b64encode(header) + base64.b64encode(body) if groups else base64.b64encode(header + body)
    inline = {
        "ascii": " ".join(map(repr, samples.ravel().tolist())).encode(),
        "binary": b"\n " + text + b"\n",
    }
    appended = {"raw": header + body, "base64": text}
    extent = f"0 {x - 1} 0 {y - 1} 0 {z - 1}"
    kind = f'format="{form}"' if form in inline else 'format="appended" offset="0"'
    endian = "LittleEndian" if order == "<" else "BigEndian"
    compressor = 'compressor="vtkZLibDataCompressor"' if compressed else ""
    head = (
        f'<?xml version="1.0"?><VTKFile type="ImageData" byte_order="{endian}" '
        f'header_type="UInt{8 * int(word[1])}" {compressor}>'
        f'<ImageData WholeExtent="{extent}" {attributes}><Piece Extent="{extent}"><PointData Scalars="v">'
        f'<DataArray type="{vtk_type}" Name="v" {array_attributes} {kind}>'
    )
    tail = b"</DataArray></PointData></Piece></ImageData>"
    if form in appended:
        tail += b'<AppendedData encoding="' + form.encode() + b'">\n_' + appended[form] + b"\n</AppendedData>"
    return head.encode() + inline.get(form, b"") + tail + b"</VTKFile>"

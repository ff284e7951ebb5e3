"""Functions of OpenGL that the binding does not offer."""

from __future__ import annotations

import ctypes
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

_UINT, _INT, _BYTE = ctypes.c_uint, ctypes.c_int, ctypes.c_ubyte
_NAMES = ctypes.POINTER(_UINT)
_GL_TEXTURE_BUFFER = 0x8C2A
_GL_READ_WRITE = 0x88BA


class Functions:
    """Buffer textures: textures whose texels are the content of a buffer (OpenGL 4.5, section 8.9).

    Parameters
    ----------
    load : callable
        Address of a function by its name, in the context that is current.
    """

    def __init__(self, load: Callable[[str], int]) -> None:
        def function(name: str, *types: type) -> Callable[..., None]:
            return ctypes.CFUNCTYPE(None, *types)(load(name))

        self._create = function("glCreateTextures", _UINT, _INT, _NAMES)
        self._delete = function("glDeleteTextures", _INT, _NAMES)
        self._attach = function("glTextureBuffer", _UINT, _UINT, _UINT)
        self._bind = function("glBindImageTexture", _UINT, _UINT, _INT, _BYTE, _INT, _UINT, _UINT)

    def create_buffer_texture(self, internal_format: int, buffer: int) -> int:
        """Name of a new buffer texture of all of a buffer."""
        name = _UINT()
        self._create(_GL_TEXTURE_BUFFER, 1, ctypes.byref(name))
        self._attach(name, internal_format, buffer)
        return int(name.value)

    def delete_texture(self, texture: int) -> None:
        """Delete a texture."""
        self._delete(1, ctypes.byref(_UINT(texture)))

    def bind_image(self, unit: int, texture: int, internal_format: int) -> None:
        """Bind a texture to an image unit, to be read and written."""
        self._bind(unit, texture, 0, 0, 0, _GL_READ_WRITE, internal_format)

"""The headless OpenGL 4.5 context and what its driver offers."""

from __future__ import annotations

import os
import threading
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from isosample.errors import OpenGLError
from isosample.gl.functions import Functions

if TYPE_CHECKING:
    from collections.abc import Iterator

    import moderngl

BACKEND_VARIABLE = "ISOSAMPLE_GL_BACKEND"
REQUIRED_VERSION = 450  # OpenGL 4.5: storage buffers, compute, image atomics, direct state access
SOFTWARE_RENDERERS = ("llvmpipe", "softpipe", "swiftshader", "swrast", "software rasterizer")
REMEDY = (
    "On Debian or Ubuntu: apt-get install libegl1 libgl1 libgl1-mesa-dri (software, no display needed); "
    "under a GPU driver: install the vendor's libEGL. Then run `isosample doctor`."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Limits:
    """What the driver allows; bytes, pixels and counts."""

    storage_block_bytes: int  # largest range of a storage buffer that a shader sees
    uniform_block_bytes: int
    framebuffer_size: tuple[int, int]  # without attachments [pixel]
    subpixel_bits: int  # of the grid to which vertices are moved before they are rasterised
    texture_size: int  # edge of a 2D texture [pixel]
    texture_3d_size: int  # edge of a 3D texture [voxel]
    buffer_texels: int  # of a buffer that is read as an image
    fragment_storage_blocks: int
    compute_storage_blocks: int
    work_group_count: tuple[int, int, int]
    work_group_size: tuple[int, int, int]
    work_group_invocations: int


def create_context() -> moderngl.Context:
    """Create a headless OpenGL 4.5 core context, made current.

    EGL is used unless the environment variable ``ISOSAMPLE_GL_BACKEND`` names another backend of glcontext;
    ``platform`` stands for the platform's own (X11, WGL, CGL; the first needs a display). Among several EGL
    devices ``GLCONTEXT_DEVICE_INDEX`` chooses one.

    Returns
    -------
    context : moderngl.Context
        To be released by the caller. Making one takes about half a second: see `shared_context`. Its attribute
        ``extra`` holds what `functions` returns.

    Raises
    ------
    OpenGLError
        If there is none; one line: what failed and what to install.
    """
    import glcontext
    import moderngl

    backend = os.environ.get(BACKEND_VARIABLE, "egl")
    native = None
    try:
        create = (
            glcontext.default_backend() if backend == "platform" else glcontext.get_backend_by_name(backend)
        )
        native = create(glversion=REQUIRED_VERSION, mode="standalone")
        context = moderngl.create_context(require=REQUIRED_VERSION, standalone=True, context=native)
        context.extra = Functions(native.load)
    except Exception as error:  # both raise bare Exception for a library, device or version that is not there
        if native is not None:
            native.release()
        reason = " ".join(str(error).split()) or type(error).__name__
        raise OpenGLError(
            f"no OpenGL {REQUIRED_VERSION // 100}.{REQUIRED_VERSION // 10 % 10} context by backend "
            f"{backend!r}: {reason}. {REMEDY}"
        ) from error
    return context


def functions(ctx: moderngl.Context) -> Functions:
    """Functions that the binding does not offer.

    Raises
    ------
    OpenGLError
        If the context is not one that `create_context` made.
    """
    found = ctx.extra
    if not isinstance(found, Functions):
        raise OpenGLError(
            "this OpenGL context is another program's; make one by isosample.gl.context.create_context."
        )
    return found


def limits(ctx: moderngl.Context) -> Limits:
    """Limits of the driver behind a context.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.

    Returns
    -------
    limits : Limits
        As the driver reports them.
    """
    info = ctx.info
    return Limits(
        storage_block_bytes=info["GL_MAX_SHADER_STORAGE_BLOCK_SIZE"],
        uniform_block_bytes=info["GL_MAX_UNIFORM_BLOCK_SIZE"],
        framebuffer_size=(info["GL_MAX_FRAMEBUFFER_WIDTH"], info["GL_MAX_FRAMEBUFFER_HEIGHT"]),
        subpixel_bits=info["GL_SUBPIXEL_BITS"],
        texture_size=info["GL_MAX_TEXTURE_SIZE"],
        texture_3d_size=info["GL_MAX_3D_TEXTURE_SIZE"],
        buffer_texels=info["GL_MAX_TEXTURE_BUFFER_SIZE"],
        fragment_storage_blocks=info["GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS"],
        compute_storage_blocks=info["GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS"],
        work_group_count=info["GL_MAX_COMPUTE_WORK_GROUP_COUNT"],
        work_group_size=info["GL_MAX_COMPUTE_WORK_GROUP_SIZE"],
        work_group_invocations=info["GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS"],
    )


def is_software(ctx: moderngl.Context) -> bool:
    """Whether the context renders on the CPU (llvmpipe, softpipe, SwiftShader)."""
    renderer = ctx.info["GL_RENDERER"].lower()
    return any(name in renderer for name in SOFTWARE_RENDERERS)


def suits_compute(ctx: moderngl.Context) -> bool:
    """Whether a pass over the pixels runs faster as a compute shader than as a fragment shader: on hardware."""
    return not is_software(ctx)


@contextmanager
def drawing_into(ctx: moderngl.Context, framebuffer: moderngl.Framebuffer) -> Iterator[None]:
    """Draw into a framebuffer inside the ``with`` block: blending, depth test and culling off.

    Parameters
    ----------
    ctx : moderngl.Context
        Current context.
    framebuffer : moderngl.Framebuffer
        The target; the viewport becomes its own.

    Yields
    ------
    None

    Notes
    -----
    Afterwards the former framebuffer is bound again, so that this one can be released. After
    ``framebuffer.use()`` the binding takes the released name for the current one, and the next framebuffer
    that is made leaves a ``GL_INVALID_OPERATION`` pending (moderngl 5.13).
    """
    scope = ctx.scope(framebuffer, ctx.NOTHING)
    try:
        with scope:
            yield
    finally:
        scope.release()


_shared: tuple[moderngl.Context, int] | None = None


def shared_context() -> moderngl.Context:
    """Return the one context of this process, made on the first call.

    Returns
    -------
    context : moderngl.Context
        Valid until `release_shared_context`; callers release their own objects, not the context.

    Raises
    ------
    OpenGLError
        As `create_context`; or if called from another thread than the first call, where it is not current.
    """
    global _shared
    if _shared is None:
        _shared = (create_context(), threading.get_ident())
    context, owner = _shared
    if owner != threading.get_ident():
        raise OpenGLError(
            "the shared OpenGL context belongs to the thread that first used it; render from that thread, "
            "or call release_shared_context there first"
        )
    return context


def release_shared_context() -> None:
    """Release the shared context, if there is one; its objects must have been released before."""
    global _shared
    if _shared is not None:
        _shared[0].release()
        _shared = None

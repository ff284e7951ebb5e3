"""Errors that isosample raises on purpose; a message names the value, what was expected, what to do."""


class IsosampleError(Exception):
    """Base of all errors raised on purpose."""


class InputError(IsosampleError, ValueError):
    """A file, an array or an option is not what was expected."""


class MissingDependencyError(InputError):
    """A file or an option needs an optional package that is not installed."""


class OpenGLError(IsosampleError):
    """No usable OpenGL 4.5 context could be made, or the driver lacks something needed."""


class ShaderError(IsosampleError):
    """A shader did not assemble, compile or link, or its interface is not what the pass supplies."""


class CapacityError(IsosampleError):
    """A scene needs more than the device or the memory budget can hold, however it is split."""


class LostFragmentsError(IsosampleError):
    """The lists do not hold every fragment that was rasterised: the picture would be wrong."""


class UnrepairedError(IsosampleError):
    """A strict picture has pixels with a lost crossing whose place nothing tells."""


class CacheError(IsosampleError):
    """A mesh cache is damaged, of another format version, or lacks what the scene needs."""

"""Random arguments for the compiled kernels: a result or an exception, and never a panic."""

import random
import warnings

import numpy as np

from mograft import _core  # noqa: TID251 - the kernels are tested themselves
from tests.attack.outcome import Outcome

_SIZES = (0, 1, 2, 3, 4, 5, 7)
_INTEGERS = (-(2**63), -(2**31), -1, 0, 1, 2, 3, 4, 5, 2**20, 2**31, 2**63 - 1)
_MAX_BYTES = 200_000_000
_PLAIN = ("BUILD_PROFILE", "VERSION")


def random_array(rng):
    """Return an array of any type, shape and layout that kernels may be given."""
    generator = np.random.default_rng(rng.randrange(2**32))
    shape = [rng.choice(_SIZES) for _ in range(rng.randint(1, 3))]
    if rng.random() < 0.5:
        shape[-1] = rng.choice((3, 4))
    kind = rng.choice("fffffffiib")
    if kind == "i":
        array = generator.integers(-2, 9, shape)
    elif kind == "b":
        array = generator.random(shape) < 0.5
    else:
        array = generator.normal(size=shape)
        if rng.random() < 0.3:
            array.flat[: rng.randint(0, 3)] = rng.choice((np.nan, np.inf, 1e308, 0.0))
        if rng.random() < 0.1:
            with np.errstate(over="ignore"):
                array = array.astype(np.float32)
    return array[..., ::2] if rng.random() < 0.05 else array


def random_value(rng):
    """Return an argument."""
    choice = rng.random()
    if choice < 0.65:
        return random_array(rng)
    if choice < 0.8:
        return rng.choice(_INTEGERS[2:9] if rng.random() < 0.9 else _INTEGERS)
    if choice < 0.88:
        return rng.choice((0.0, 0.5, 1.0, -1.0, 1e-9, 1e308, float("nan"), float("inf")))
    if choice < 0.96:
        return [random_value(rng) for _ in range(rng.randint(0, 3))]
    return rng.choice((None, True, False, "ZXY", b"1 2 3\n", (1, 2), [(0, 1)]))


def kernel_calls(folder, count):  # noqa: ARG001 - all experiments have these arguments
    """Call kernels with random arguments."""
    outcome, rng = Outcome(), random.Random(0)
    kernels = [getattr(_core, name) for name in _core.__all__ if name not in _PLAIN]
    for _ in range(count):
        kernel = rng.choice(kernels)
        parameters = kernel.__text_signature__ or ""
        n = (
            parameters.count(",") + (parameters != "()")
            if rng.random() < 0.98
            else rng.randint(0, 6)
        )
        arguments = [random_value(rng) for _ in range(n)]
        outcome.trials += 1
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                kernel(*arguments)
        except Exception:
            continue
        except BaseException as error:
            outcome.failures.append(f"{kernel.__name__}: {error!r}"[:300])
    return outcome

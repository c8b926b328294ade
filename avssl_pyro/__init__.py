"""Self-supervised audio-visual sound source localization with a spatial mixture model in Pyro."""

from pathlib import Path as _Path

# Started from a checkout, the on-disk package shadows an installed one, and its `models` and `guides` lie one level
# up; without this line `import avssl_pyro.models` would depend on the working directory.
_checkout = _Path(__file__).resolve().parent.parent
if (_checkout / "models" / "spatial_cgmm.py").is_file():
    __path__.append(str(_checkout))

__version__ = "0.1.0"

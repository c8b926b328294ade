"""Runs mypy on the package and the scripts; exits with mypy's code.

mypy resolves `avssl_pyro.models` by its place on disk, not by the package map of pyproject.toml, so it is shown a
folder of symlinks laid out like an installed package. Paths in its messages are those of the checkout again.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
# Where the package map puts folders that lie outside avssl_pyro/.
MAPPED = ("models", "guides")


def lay_out(folder: Path) -> None:
    """Links everything mypy should see into ``folder``, as an installation would lay it out."""
    package = folder / "avssl_pyro"
    package.mkdir()
    for source in (ROOT / "avssl_pyro").iterdir():
        if source.name != "__pycache__":
            (package / source.name).symlink_to(source)
    for name in MAPPED:
        (package / name).symlink_to(ROOT / name)
    (folder / "scripts").symlink_to(ROOT / "scripts")


def real_paths(report: str) -> str:
    """Undoes the layout in mypy's messages."""
    return re.sub(rf"(?m)^avssl_pyro/({'|'.join(MAPPED)})/", r"\1/", report)


def main() -> int:
    with tempfile.TemporaryDirectory(prefix="avssl-mypy-") as name:
        folder = Path(name)
        lay_out(folder)
        scripts = [f"scripts/{path.name}" for path in sorted((ROOT / "scripts").glob("*.py"))]
        command = [sys.executable, "-m", "mypy", "--config-file", str(ROOT / "pyproject.toml")]
        command += ["--cache-dir", str(ROOT / ".mypy_cache"), "avssl_pyro", *scripts, *sys.argv[1:]]
        finished = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    sys.stdout.write(real_paths(finished.stdout))
    sys.stderr.write(real_paths(finished.stderr))
    return finished.returncode


if __name__ == "__main__":
    sys.exit(main())

"""Makes a stand-in for the official Python base image, if no image registry can be reached.

It is a minimal Debian of the tag's suite, made with mmdebstrap from this machine's apt sources.
This machine's CPython of the tag's minor version is in /usr/local, else Debian's python3. It has
this machine's certificates and pip settings, so that the unchanged Dockerfile reaches the same
hosts. Use it only to test the Dockerfile; never publish it.
"""

from __future__ import annotations

import glob
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

# Libraries that a CPython built on this machine links to, and that not every Debian has.
_LIBRARIES = (
    "ca-certificates",
    "libbz2-1.0",
    "libffi8",
    "liblzma5",
    "libsqlite3-0",
    "libssl3",
    "zlib1g",
)
_DEBIAN_PYTHON = ("python3", "python3-dev", "python3-pip", "python3-venv", "python-is-python3")
_LEFT_OUT = (
    "*/test",
    "*/tests",
    "*/idlelib",
    "*/__pycache__",
    "*/site-packages/[!p]*",
    "*.a",
    "./share",
)


def tarball(image: str) -> Path:
    """Return a root file system in place of ``image``, such as ``python:3.12-slim-bookworm``.

    It is kept in the user's cache folder.
    """
    match = re.fullmatch(r"python:(\d+\.\d+)-slim-(\w+)", image)
    if match is None:
        raise SystemExit(f"cannot make a stand-in for the base image {image}")
    minor, suite = match.groups()
    prefix = next(_prefixes(minor), None)
    kind = f"cpython-{minor}" if prefix else "debian-python"
    cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "zenoh-tf"
    path = cache / f"stand-in-{suite}-{kind}.tar"
    if not path.exists():
        cache.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory() as scratch:
            _make(path, suite, prefix, Path(scratch))
    return path


def _make(path: Path, suite: str, prefix: Path | None, scratch: Path) -> None:
    packages = _LIBRARIES if prefix else (*_LIBRARIES, *_DEBIAN_PYTHON)
    hooks = []
    if prefix:
        left_out = " ".join(f"--exclude={shlex.quote(pattern)}" for pattern in _LEFT_OUT)
        source = shlex.quote(str(prefix))
        hooks += [
            f'tar -C {source} {left_out} -cf - . | tar -C "$1/usr/local" --no-same-owner -xf -',
            'ln -sf python3 "$1/usr/local/bin/python"',
            'chroot "$1" ldconfig',
            'chroot "$1" python -c "import bz2, ctypes, lzma, pip, sqlite3, ssl, venv, zlib"',
        ]
    bundle = os.environ.get("SSL_CERT_FILE", "/etc/ssl/certs/ca-certificates.crt")
    if Path(bundle).exists():
        hooks.append(f'cp {shlex.quote(bundle)} "$1/etc/ssl/certs/ca-certificates.crt"')
    settings = scratch / "pip.conf"
    settings.write_text(_pip_settings())
    hooks.append(f'cp {settings} "$1/etc/pip.conf"')

    unfinished = path.with_suffix(".part.tar")
    command = ["mmdebstrap", "--quiet", "--variant=minbase", f"--include={','.join(packages)}"]
    command += [f"--customize-hook={hook}" for hook in hooks]
    subprocess.run([*command, suite, str(unfinished), *_apt_sources(suite)], check=True)
    unfinished.replace(path)


def _prefixes(minor: str) -> Iterator[Path]:
    """Yield the prefixes outside of /usr with a CPython of this minor version."""
    names = [shutil.which(f"python{minor}") or "", f"/usr/local/bin/python{minor}"]
    names += sorted(glob.glob(str(Path.home() / f".pyenv/versions/{minor}.*/bin/python{minor}")))
    for name in names:
        found = (
            subprocess.run(
                [name or "false", "-c", "import sys; print(sys.base_prefix)"],
                capture_output=True,
                text=True,
                check=False,
            )
            if name and Path(name).exists()
            else None
        )
        if found and found.returncode == 0 and found.stdout.strip() != "/usr":
            yield Path(found.stdout.strip())


def _apt_sources(suite: str) -> list[str]:
    """Return this machine's sources of the suite; none means mmdebstrap's default."""
    for path in map(Path, ("/etc/apt/sources.list.d/debian.sources", "/etc/apt/sources.list")):
        if path.exists() and re.search(rf"\b{suite}\b", path.read_text()):
            return [str(path)]
    return []


def _pip_settings() -> str:
    """Return a pip.conf with this machine's package index."""
    listed = subprocess.run(
        ["python3", "-m", "pip", "config", "list"], capture_output=True, text=True, check=False
    )
    lines = ["[global]"]
    for key, value in re.findall(r"^(?:global|:env:)\.([\w-]+)='(.*)'$", listed.stdout, re.M):
        # An index in a folder of this machine does not exist in the image.
        if (
            key in ("index-url", "extra-index-url", "proxy", "trusted-host")
            and "file:" not in value
        ):
            lines.append(f"{key} = {value}")
    lines.append("cert = /etc/ssl/certs/ca-certificates.crt")
    return "\n".join(dict.fromkeys(lines)) + "\n"

"""docker/certificates.sh; test_compose.py has servers and clients that use what it makes."""

from __future__ import annotations

import ssl
import stat
import subprocess
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "docker" / "certificates.sh"


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [SCRIPT, *arguments], capture_output=True, text=True, timeout=150, check=False
    )


def test_keys_are_for_their_owner_only_and_nothing_is_overwritten(tmp_path: Path) -> None:
    folder = tmp_path / "my trial"
    first = run(str(folder), "robot.local,10.0.0.5,::1", "nav")
    assert first.returncode == 0, first.stderr
    content = {path.name: path.read_bytes() for path in folder.iterdir()}
    assert sorted(content) == sorted(
        f"{name}{end}.pem" for name in ("ca", "server", "nav") for end in ("", "-key")
    )
    for path in folder.iterdir():
        expected = 0o600 if "key" in path.name else 0o644
        assert stat.S_IMODE(path.stat().st_mode) == expected, path
    again = run(str(folder), "robot.local")
    assert again.returncode == 1 and "server.pem exists: choose another name" in again.stderr
    assert run(str(folder), "", "late").returncode == 0
    for name, old in content.items():
        assert (folder / name).read_bytes() == old
    context = ssl.create_default_context(cafile=str(folder / "ca.pem"))
    context.load_cert_chain(folder / "late.pem", folder / "late-key.pem")
    shown = subprocess.check_output(
        ["openssl", "x509", "-in", folder / "server.pem", "-noout", "-ext", "subjectAltName"]
    )
    assert b"DNS:robot.local, IP Address:10.0.0.5, IP Address:0:0:0:0:0:0:0:1" in shown

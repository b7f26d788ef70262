"""Certificates of authorities that trustme makes."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path

import trustme

from zenoh_tf_client import Credentials


def issue(
    authority: trustme.CA,
    folder: Path,
    name: str,
    hosts: Sequence[str] = (),
    begin: datetime.datetime | None = None,
    end: datetime.datetime | None = None,
) -> Credentials:
    """Write a client's certificate, or that of a server at these hosts, its key, and `ca.pem`."""
    folder.mkdir(exist_ok=True)
    ca, certificate, key = (folder / f"{each}.pem" for each in ("ca", name, f"{name}-key"))
    made = authority.issue_cert(
        *(hosts or ["client.example"]), common_name=name, not_before=begin, not_after=end
    )
    authority.cert_pem.write_to_path(ca)
    made.cert_chain_pems[0].write_to_path(certificate)
    made.private_key_pem.write_to_path(key)
    key.chmod(0o600)
    return Credentials(ca=str(ca), certificate=str(certificate), key=str(key))

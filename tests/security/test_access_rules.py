"""Rules for users with certificates, over real TLS, and a server without admin requests."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import pytest

from tests.conftest import StartServer
from zenoh_tf import StampedTransform, Transform
from zenoh_tf.errors import AccessDenied
from zenoh_tf_client import Credentials

from .conftest import PASSWORDS, Files, Serve, connect

#: For all clients, and for one user with one certificate.
RULES_FOR_BOTH = """
[[access]]
may = ["read"]

[[access]]
users = ["arm"]
certificates = ["wheels"]
may = ["clear"]
"""


def test_a_rule_with_users_and_certificates_is_for_clients_with_both(
    files: Files, serve: Serve, tmp_path: Path
) -> None:
    config = tmp_path / "server.toml"
    config.write_text(RULES_FOR_BOTH)
    flags = [*files.server_flags(), "--users", files.users, "--tls-ca", files.ca]
    server = serve("--config", str(config), *flags)

    def credentials(user: str, certificate: str) -> Credentials:
        owner = files.owner(certificate)
        return Credentials(files.ca, owner.certificate, owner.key, user, PASSWORDS[user])

    with connect(server, credentials("arm", "wheels")) as tf:
        tf.clear()
        assert tf.frames() == []
    for user, certificate in (("arm", "reader"), ("reader", "wheels")):
        with connect(server, credentials(user, certificate)) as tf:
            assert tf.frames() == []
            with pytest.raises(AccessDenied, match=f"'{user}'.* may not clear"):
                tf.clear()
    for one_alone in (files.user("arm"), files.owner("wheels")):
        with pytest.raises(AccessDenied, match="wants a"):
            connect(server, one_alone, timeout_s=1.5)


def test_no_admin(start_server: StartServer) -> None:
    with start_server("--no-admin").connect() as tf:
        tf.set_transform(StampedTransform("map", "base", 1, Transform()))
        for run in (tf.clear, tf.reset, partial(tf.remove_frame, "base")):
            with pytest.raises(AccessDenied, match="--no-admin"):
                run()
        assert len(tf.frames()) == 2

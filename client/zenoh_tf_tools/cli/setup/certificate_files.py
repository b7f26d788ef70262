"""Makes certificates for a trial with ``cryptography``: an authority, and what it signs.

Keys are of the curve P-256 and are written for their owner only. A certificate that is there
already is never overwritten.
"""

from __future__ import annotations

import datetime
import ipaddress
import os
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from zenoh_tf_tools.errors import CommandError

try:
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import ec
    from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID
except ImportError as error:
    raise CommandError(
        f"certificates are made with cryptography, which is not installed ({error}); install it "
        "with: pip install 'zenoh-tf[security]'"
    ) from error

_AUTHORITY: Final = "ca"
#: Clocks of machines differ: a certificate is valid this long before it is made.
_MARGIN: Final = datetime.timedelta(minutes=5)
#: A common name has at most this many characters.
_MAX_NAME: Final = 64


@dataclass(frozen=True, slots=True)
class Period:
    """When a certificate is valid."""

    begin: datetime.datetime
    end: datetime.datetime


def period_of(days: float) -> Period:
    """A period of `days` from now."""
    now = datetime.datetime.now(datetime.UTC)
    return Period(now - _MARGIN, now + datetime.timedelta(days=days))


class Authority:
    """The authority of one folder, in its files ``ca.pem`` and ``ca-key.pem``."""

    def __init__(self, folder: Path, period: Period) -> None:
        """Read the folder's authority, or make one if there is none.

        Raises:
            CommandError: Its files cannot be read or written.
        """
        self._folder = folder
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if certificate_file(folder, _AUTHORITY).exists():
                self._read()
            else:
                self._make(period)
        except (OSError, ValueError) as error:
            raise CommandError(f"cannot use the authority in {folder}: {error}") from error

    def _read(self) -> None:
        self._certificate = x509.load_pem_x509_certificate(
            certificate_file(self._folder, _AUTHORITY).read_bytes()
        )
        key = serialization.load_pem_private_key(
            key_file(self._folder, _AUTHORITY).read_bytes(), None
        )
        if not isinstance(key, ec.EllipticCurvePrivateKey):
            raise ValueError("its key is of another kind")
        self._key = key

    def _make(self, period: Period) -> None:
        self._key = ec.generate_private_key(ec.SECP256R1())
        # Authorities of different folders have different names: a mix-up is told as such.
        name = _name(f"zenoh-tf trial authority {secrets.token_hex(4)}")
        self._certificate = (
            _builder(name, name, self._key, period)
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_key_usage(signs_certificates=True), critical=True)
            .add_extension(
                x509.SubjectKeyIdentifier.from_public_key(self._key.public_key()), critical=False
            )
            .sign(self._key, hashes.SHA256())
        )
        _write(self._folder, _AUTHORITY, self._certificate, self._key)

    def issue(self, name: str, hosts: Sequence[str], period: Period) -> None:
        """Write a certificate and its key for `name`: of a server if it has hosts, which may also
        connect as a client, else of a client.

        Raises:
            CommandError: The name is unusable, or the files cannot be written or exist already.
        """
        if not 0 < len(name) <= _MAX_NAME or "/" in name or name.startswith("."):
            raise CommandError(f"{name!r} cannot be the name of a certificate and its file")
        key = ec.generate_private_key(ec.SECP256R1())
        usages = [ExtendedKeyUsageOID.CLIENT_AUTH]
        if hosts:
            usages.append(ExtendedKeyUsageOID.SERVER_AUTH)
        builder = _builder(_name(name), self._certificate.subject, key, period)
        if hosts:
            alternatives = x509.SubjectAlternativeName([*map(_alternative_name, hosts)])
            builder = builder.add_extension(alternatives, critical=False)
        certificate = (
            builder.add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_key_usage(signs_certificates=False), critical=True)
            .add_extension(x509.ExtendedKeyUsage(usages), critical=False)
            .add_extension(
                x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key()),
                critical=False,
            )
            .sign(self._key, hashes.SHA256())
        )
        try:
            _write(self._folder, name, certificate, key)
        except FileExistsError as error:
            raise CommandError(
                f"{error.filename} is there already: choose another name, or remove it first"
            ) from error
        except OSError as error:
            raise CommandError(f"cannot write the certificate of {name!r}: {error}") from error


def certificate_file(folder: Path, name: str) -> Path:
    """The file of a certificate."""
    return folder / f"{name}.pem"


def key_file(folder: Path, name: str) -> Path:
    """The file of a certificate's private key."""
    return folder / f"{name}-key.pem"


def authority_file(folder: Path) -> Path:
    """The file of the authority's certificate, which every machine needs."""
    return certificate_file(folder, _AUTHORITY)


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _alternative_name(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        pass
    try:
        return x509.DNSName(host)
    except ValueError as error:
        raise CommandError(f"{host!r} is no host name or address: write it in ASCII") from error


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePrivateKey, period: Period
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key.public_key())
        .serial_number(x509.random_serial_number())
        .not_valid_before(period.begin)
        .not_valid_after(period.end)
    )


def _key_usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        key_cert_sign=signs_certificates,
        crl_sign=signs_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _write(
    folder: Path, name: str, certificate: x509.Certificate, key: ec.EllipticCurvePrivateKey
) -> None:
    private = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    public = certificate.public_bytes(serialization.Encoding.PEM)
    for path, content, mode in (
        (key_file(folder, name), private, 0o600),
        (certificate_file(folder, name), public, 0o644),
    ):
        # The file never exists with another mode, nor over another one.
        descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
        with os.fdopen(descriptor, "wb") as file:
            file.write(content)

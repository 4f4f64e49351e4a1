"""How the connection is secured, and how a call says who makes it."""

from __future__ import annotations

import dataclasses
import ipaddress
import pathlib
import ssl
from typing import Optional, Sequence, Tuple, Union

import grpc


@dataclasses.dataclass(frozen=True)
class Tls:
    """Encryption. All but `server_name` are paths of PEM files."""

    root_certificates: str = ""  # whose servers are trusted; empty: the system's authorities
    certificate: str = ""  # of this client, where the server asks for one
    key: str = ""  # of that certificate
    server_name: str = ""  # in the server's certificate; empty: the address's


@dataclasses.dataclass(frozen=True)
class ServerAddress:
    """One server, or several that answer alike."""

    target: str  # as gRPC takes it
    several: bool  # calls go in turn to those that are ready
    all: Tuple[str, ...]  # each as it was given, without a scheme


DEFAULT_PORT = 8470


def _host(address: str) -> str:
    return address.rpartition(":")[0].strip("[]")


def _ip_version(address: str) -> Optional[int]:
    try:
        return ipaddress.ip_address(_host(address)).version
    except ValueError:
        return None


def _with_port(address: str) -> str:
    """Adds the default port to "localhost", "10.0.0.1", "[::1]" and "::1"; checks one that is there."""
    if address.startswith(("unix:", "unix-abstract:")):
        return address
    try:
        if ipaddress.ip_address(address).version == 6:
            return f"[{address}]:{DEFAULT_PORT}"
    except ValueError:
        pass
    is_bracketed = address.startswith("[") and address.endswith("]")
    if is_bracketed or ":" not in address:
        return f"{address}:{DEFAULT_PORT}"
    port = address.rpartition(":")[2]
    # gRPC would connect to the port modulo 65536.
    if port.isdecimal() and not 1 <= int(port) <= 65535:
        raise ValueError(f"{address}: the port is not from 1 to 65535")
    return address


def parse_address(address: str) -> ServerAddress:
    """Reads the address that a Client is given; ValueError says what is wrong with it."""
    if not address:
        raise ValueError("address is empty; name the server as HOST:PORT")
    for scheme in ("http://", "https://", "grpc://", "grpcs://"):
        if address.startswith(scheme):
            raise ValueError(f"{address}: name the server as HOST:PORT, without {scheme}")
    if address.startswith("dns:///"):
        if address == "dns:///" or address.startswith("dns:///:"):
            raise ValueError(f"{address}: a name is missing, as in dns:///NAME:PORT")
        name = _with_port(address[len("dns:///"):])
        return ServerAddress("dns:///" + name, True, (name,))
    every = tuple(_with_port(one) for one in address.split(","))
    address = ",".join(every)
    if len(every) == 1:
        return ServerAddress(address, False, every)
    versions = {_ip_version(one) for one in every}
    if versions not in ({4}, {6}):
        raise ValueError(
            f"{address}: several servers are named by their addresses, all IPv4 (10.0.0.1:8470,"
            "10.0.0.2:8470) or all IPv6 ([fd00::1]:8470,...), or by a name that stands for all of "
            "them: dns:///NAME:PORT")
    scheme = "ipv4:" if versions == {4} else "ipv6:"
    return ServerAddress(scheme + address, True, every)


def is_local(address: str) -> bool:
    """Whether nobody but this machine sees what goes there."""
    if address.startswith(("unix:", "unix-abstract:")):
        return True

    def is_loopback(one: str) -> bool:
        return _host(one) == "localhost" or (
            _ip_version(one) is not None and ipaddress.ip_address(_host(one)).is_loopback)

    return all(is_loopback(one) for one in parse_address(address).all)


def authorization(address: str, tls: Optional[Tls], token: str,
                  token_file: str) -> Sequence[Tuple[str, str]]:
    """Returns the metadata that says who calls; empty without a token.

    Raises ValueError for a token that is not one word, or that would cross the network in plain
    text.
    """
    if token_file:
        token = pathlib.Path(token_file).read_text(encoding="utf-8-sig").rstrip()
        if not token:
            raise ValueError(f"{token_file} holds no token")
    if not token:
        return ()
    if not all(" " < character < "\x7f" for character in token):
        raise ValueError("a token is one word of ASCII characters, and this is not")
    if tls is None and not is_local(address):
        raise ValueError(f"the token is not sent to {address} in plain text, where others could "
                         "read it; use tls=maneuver.Tls(...)")
    return (("authorization", f"Bearer {token}"),)


_KINDS = {b"CERTIFICATE-----": "certificate", b"PRIVATE KEY-----": "private key"}


def _read_pem(file: str, wanted: bytes) -> Optional[bytes]:
    """Reads a PEM file that has to hold one of _KINDS; None for no file."""
    if not file:
        return None
    pem = pathlib.Path(file).read_bytes()
    if b"-----BEGIN" not in pem:
        raise ValueError(f"{file} is not in PEM format")
    if wanted not in pem:
        held = [f"a {kind}" for mark, kind in _KINDS.items() if mark in pem] or ["something else"]
        raise ValueError(f"{file} holds {held[0]}, not a {_KINDS[wanted]}")
    return pem


def _check_pair(certificate: str, key: str) -> None:
    """Raises ValueError for files that gRPC could not use: it says only that it cannot connect."""
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.set_ciphers("ALL:@SECLEVEL=0")  # whether a key is strong enough is for the server to say
    try:
        context.load_cert_chain(certificate, key, password="")  # gRPC has no way to ask for one
    except ssl.SSLError as error:
        if error.reason in ("KEY_VALUES_MISMATCH", "KEY_TYPE_MISMATCH", "NO_CERTIFICATE_ASSIGNED"):
            raise ValueError(f"{key} is not the key of the certificate in {certificate}") from None
        raise ValueError(f"the certificate in {certificate} or the key in {key} is damaged, or the "
                         "key has a passphrase") from None


def channel_credentials(tls: Union[Tls, None]) -> Optional[grpc.ChannelCredentials]:
    """Reads the files that `tls` names. None for plain text.

    Raises OSError for files that cannot be read, ValueError for those that hold something else or
    do not fit one another.
    """
    if tls is None:
        return None
    if bool(tls.certificate) != bool(tls.key):
        raise ValueError("a client certificate and its key need one another")
    roots = _read_pem(tls.root_certificates or ssl.get_default_verify_paths().cafile or "",
                      b"CERTIFICATE-----")
    certificate = _read_pem(tls.certificate, b"CERTIFICATE-----")
    key = _read_pem(tls.key, b"PRIVATE KEY-----")
    if tls.certificate:
        _check_pair(tls.certificate, tls.key)
    return grpc.ssl_channel_credentials(roots, key, certificate)

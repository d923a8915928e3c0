"""Which addresses of the network a stranger may send this service to: of sources of files, and of callbacks."""

import ipaddress
import re

import httpx

from service.errors import AddressRefusedError

MAX_HREF = 2000
PORTS = {"https": 443, "http": 80}
HOST_NAME = re.compile(
    r"(?=.{1,253}$)([a-z0-9_]([a-z0-9_-]{0,61}[a-z0-9_])?\.)*[a-z0-9_]([a-z0-9_-]{0,61}[a-z0-9_])?\.?"
)
NUMERIC_LABEL = re.compile(r"0x[0-9a-f]*|[0-9]+")
"""As the last label of a name it makes readers take the whole for an address of IPv4, in one of many notations."""
NOT_FOR_STRANGERS = tuple(
    ipaddress.ip_network(text)
    for text in (
        "192.0.0.0/24",  # of the protocols themselves; some clouds serve credentials here
        "192.88.99.0/24",  # relays of 6to4
        "168.63.129.16/32",  # the wire server of a cloud: a public number that never leaves the machine's host
        "2001::/23",  # of the protocols themselves, Teredo among them
        "2001:db8::/32",
        "2002::/16",  # 6to4: stands for an address of IPv4
        "3fff::/20",
    )
)
OF_THE_HOST = tuple(
    ipaddress.ip_network(text)
    for text in (
        "169.254.0.0/16",  # link-local: most clouds serve credentials of the machine at 169.254.169.254
        "fe80::/10",
        "192.0.0.192/32",
        "168.63.129.16/32",
        "100.100.100.200/32",
        "fd00:ec2::/32",
        "fd20:ce::/32",
    )
)
"""Where clouds serve credentials and settings of the machine to whoever asks from it."""
IPV4_IN_IPV6 = tuple(
    ipaddress.ip_network(text) for text in ("::ffff:0:0/96", "::/96", "64:ff9b::/96", "64:ff9b:1::/48")
)
"""Addresses of IPv6 whose last 32 bits are one of IPv4: mapped, compatible, NAT64."""
SIX_TO_FOUR = ipaddress.ip_network("2002::/16")
UNICAST_IPV6 = ipaddress.ip_network("2000::/3")
"""The only part of IPv6 that is given out; all that disguises IPv4 (mapped, compatible, NAT64) lies outside it."""


def is_public(address: str) -> bool:
    """Tell whether an address of the network belongs to the public internet and stands for no other one."""
    try:
        ip = ipaddress.ip_address(address)
    except ValueError:  # with a zone, as link-local ones have, or none at all
        return False
    if isinstance(ip, ipaddress.IPv6Address) and (ip not in UNICAST_IPV6 or ip.scope_id is not None):
        return False
    inside = ip.is_multicast or ip.is_reserved or any(ip in network for network in NOT_FOR_STRANGERS)
    return ip.is_global and not inside


def is_of_the_host(address: str) -> bool:
    """Tell whether an address is one at which a cloud serves credentials of the machine, however it is written."""
    try:
        ip = ipaddress.ip_address(address.partition("%")[0])
    except ValueError:
        return True
    meant = [ip]
    if isinstance(ip, ipaddress.IPv6Address):
        if any(ip in network for network in IPV4_IN_IPV6):
            meant.append(ipaddress.IPv4Address(int(ip) & 0xFFFFFFFF))
        if ip in SIX_TO_FOUR:
            meant.append(ipaddress.IPv4Address(int(ip) >> 80 & 0xFFFFFFFF))
    return any(each in network for each in meant for network in OF_THE_HOST)


def parsed_address(href: str) -> httpx.URL:
    """Read an address strictly, without asking anybody.

    Raises
    ------
    AddressRefusedError
        It is not of the form ``https://host[:port]/path``, or could be read in two ways.
    """
    if len(href) > MAX_HREF:
        raise AddressRefusedError(f"{href[:50]}…", f"the address has more than {MAX_HREF} characters")
    if not href.isprintable() or any(letter.isspace() or letter == "\\" for letter in href):
        raise AddressRefusedError(repr(href)[1:-1], "an address has no blanks, control characters and backslashes")
    try:
        url = httpx.URL(href)
    except httpx.InvalidURL as error:
        raise AddressRefusedError(href, f"this is no address: {error}") from None
    authority = re.sub(r"^[^:/?#]*://", "", href).partition("/")[0].partition("?")[0].partition("#")[0]
    if url.scheme not in PORTS or not url.host or "@" in authority or "#" in href:
        raise AddressRefusedError(
            href, "an address of the form https://host/path without user name and fragment is expected"
        )
    if not authority.isascii():
        raise AddressRefusedError(href, "write the name of the host in letters of ASCII (xn--…)")
    if not _is_host(url.raw_host.decode("ascii")):
        raise AddressRefusedError(href, "its host is neither a name nor an address in the usual notation")
    if url.port is not None and not 0 < url.port < 65536:
        raise AddressRefusedError(href, "there is no such port")
    return url


def _is_host(host: str) -> bool:
    """Tell whether a host is written in the one way in which nobody takes it for another."""
    if ":" in host:
        return "%" not in host  # the parser has found it to be IPv6
    if NUMERIC_LABEL.fullmatch(host.rstrip(".").rpartition(".")[2]):
        try:
            ipaddress.IPv4Address(host)
        except ValueError:
            return False
        return True
    return HOST_NAME.fullmatch(host) is not None

"""Where a stream is offered and found."""

import re

DEFAULT_ADDRESS = "tcp://127.0.0.1:5599"
FORM = re.compile(r"tcp://[^\s/]+:(?P<port>[0-9]{1,5}|\*)|ipc://\S+")
MOST_PORT = 65535
LOCAL = re.compile(r"tcp://(127\.[0-9.]+|localhost|\[::1\]):|ipc:")


class AddressError(ValueError):
    """Text that is no address; the message is one line."""


def require(address: str) -> None:
    """Raise AddressError for what is no address: ZeroMQ takes port 99999 for another one."""
    found = FORM.fullmatch(address)
    port = found["port"] if found else None
    if found is None or (port is not None and port != "*" and int(port) > MOST_PORT):
        raise AddressError(
            f"{address}: expected an address such as {DEFAULT_ADDRESS} or ipc:///run/fastac.ipc"
        )


def is_local(address: str) -> bool:
    """Whether only programs on this machine can reach the address."""
    return LOCAL.match(address) is not None

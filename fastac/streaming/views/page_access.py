"""Who may see the page, and its files.

A request needs the token of the page's address, in the address or in the cookie that the page sets, and must
be meant for this server: the name in Host is an IP address, localhost or the machine's own (a page elsewhere
whose name was made to point here has another one), and Origin, where there is one, is the page itself.
"""

import secrets
import socket
from http.cookies import CookieError, SimpleCookie
from importlib.resources import files
from ipaddress import ip_address
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request, Response

STREAM = "/stream"
FILES = {
    "/": ("index.html", "text/html; charset=utf-8"),
    "/page.css": ("page.css", "text/css; charset=utf-8"),
    **{
        f"/{name}.js": (f"{name}.js", "text/javascript; charset=utf-8")
        for name in ("page", "wire", "surface", "curves", "pictures")
    },
}
"""The page's files by path, and their types."""
SAFE = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'self'; img-src 'self' data:; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Connection": "close",
}


class Access:
    """The rules for one server.

    host, port : where it listens; token : the secret of its address; None: a new one
    """

    def __init__(self, host: str, port: int, token: str | None = None):
        self.token = token or secrets.token_urlsafe(24)
        self._names = {"localhost", host.lower(), socket.gethostname().lower()}
        self._cookie = f"fastac-{port}"  # a browser sends cookies to every port of a machine

    def answer(self, request: Request) -> Response | None:
        """What to answer; None: it asks for the stream and may have it."""
        try:
            return self._answer(request)
        except ValueError:  # of urllib, for what is no address
            return _response(400, "Bad Request", "no address")

    def _answer(self, request: Request) -> Response | None:
        try:
            host, origin = request.headers["Host"], request.headers.get("Origin")
        except (KeyError, MultipleValuesError):
            return _response(400, "Bad Request", "one Host, please")
        if not self._is_own(host):
            return _response(403, "Forbidden", f"{host}: not a name of this machine")
        if origin is not None and urlsplit(origin).netloc != host:
            return _response(403, "Forbidden", f"{origin}: not this page")
        asked = urlsplit(request.path)
        if not self._is_known(request, asked.query):
            return _response(403, "Forbidden", "wrong token: use the address that fastac live has printed")
        if asked.path == STREAM:
            return None
        if asked.path not in FILES:
            return _response(404, "Not Found", "no such file")
        name, kind = FILES[asked.path]
        content = files("fastac.streaming.views").joinpath("page", name).read_bytes()
        kept = {"Set-Cookie": f"{self._cookie}={self.token}; Path=/; HttpOnly; SameSite=Strict"}
        return _response(200, "OK", content, {"Content-Type": kind} | (kept if asked.path == "/" else {}))

    def _is_own(self, host: str) -> bool:
        """Whether Host names this machine in a way that nobody else can choose."""
        name = (urlsplit(f"//{host}").hostname or "").lower()
        if name in self._names:
            return True
        try:
            ip_address(name)
        except ValueError:
            return False
        return True

    def _is_known(self, request: Request, query: str) -> bool:
        """Whether the request brings the token."""
        given = parse_qs(query).get("token", [])
        for header in request.headers.get_all("Cookie"):
            try:
                cookies = SimpleCookie(header)
            except CookieError:
                continue
            given += [cookies[self._cookie].value] if self._cookie in cookies else []
        wanted = self.token.encode()
        return any(secrets.compare_digest(one.encode(), wanted) for one in given)


def _response(status: int, reason: str, content: str | bytes, more: dict[str, str] | None = None) -> Response:
    body = content if isinstance(content, bytes) else f"{content}\n".encode()
    fixed = {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body))}
    return Response(status, reason, Headers({**SAFE, **fixed, **(more or {})}), body)

"""Bodies of requests that are read within a limit, and the types of ASGI."""

from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any

Scope = MutableMapping[str, Any]
Message = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Message]]
Send = Callable[[Message], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]


class TooLarge(Exception):
    """The body goes on beyond its limit."""


class Counted:
    """A body that ends when it is too long.

    Args:
        receive: the server's.
        limit: bytes.
    """

    def __init__(self, receive: Receive, limit: int) -> None:
        self.receive = receive
        self.left = limit
        self.exceeded = False

    async def __call__(self) -> Message:
        """The next part.

        Raises:
            TooLarge: when the limit is passed.
        """
        message = await self.receive()
        self.left -= len(message.get("body", b""))
        if self.left < 0:
            self.exceeded = True
            raise TooLarge
        return message

    async def all(self) -> bytes | None:
        """The whole body, ``None`` when it is too long or breaks off."""
        parts = []
        try:
            while True:
                message = await self()
                if message["type"] != "http.request":
                    return None
                parts.append(message.get("body", b""))
                if not message.get("more_body"):
                    return b"".join(parts)
        except TooLarge:
            return None


def replay(body: bytes, receive: Receive) -> Receive:
    """The body once, then whatever else comes."""
    waiting = [{"type": "http.request", "body": body, "more_body": False}]

    async def again() -> Message:
        return waiting.pop() if waiting else await receive()

    return again

"""Browser view of `scope`: the server of matplotlib, made robust against closed tabs and invalid messages."""

import asyncio
import contextlib
import json
import logging
from typing import Any


def serve_any_page() -> None:
    """Let the server of matplotlib tolerate closed tabs and foreign messages without a traceback."""
    from matplotlib._pylab_helpers import Gcf
    from matplotlib.backends import backend_webagg
    from tornado.iostream import StreamClosedError
    from tornado.websocket import WebSocketClosedError

    application: Any = backend_webagg.WebAggApplication
    closed = (WebSocketClosedError, StreamClosedError)

    class Page(application.WebSocket):  # type: ignore[misc]
        """Browser tab."""

        def write_message(self, message: Any, binary: bool = False) -> 'asyncio.Future[None]':
            try:
                sent: asyncio.Future[None] = super().write_message(message, binary)
            except closed:
                sent = asyncio.get_event_loop().create_future()
                sent.set_result(None)
            else:
                # Retrieve the exception, so that asyncio does not report a tab that was closed during transmission.
                sent.add_done_callback(lambda done: done.cancelled() or done.exception())
            return sent

        def open(self, fignum: str) -> None:
            if Gcf.get_fig_manager(int(fignum)) is None:
                self.close()
            else:
                super().open(fignum)

        def on_close(self) -> None:
            with contextlib.suppress(AttributeError, KeyError):  # the tab was never opened, or the figure is closed
                super().on_close()

        def on_message(self, message: Any) -> None:
            with contextlib.suppress(ValueError, TypeError, KeyError, AttributeError, RecursionError):
                if isinstance(json.loads(message), dict):
                    super().on_message(message)

    if not isinstance(application.WebSocket, type) or application.WebSocket.__name__ != Page.__name__:
        application.WebSocket = Page
    # The remaining messages also concern clients: a reset connection, or a request that is not HTTP.
    for name in ('tornado.general', 'tornado.access', 'tornado.application'):
        logging.getLogger(name).setLevel(logging.CRITICAL)

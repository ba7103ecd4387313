"""The view of `scope` in the browser: matplotlib's, for pages that come, go and send what they like."""

import asyncio
import contextlib
import json
import logging
from typing import Any


def serve_any_page() -> None:
    """Let matplotlib's server of pages bear closed tabs, and messages that are none of its own, without a traceback."""
    from matplotlib._pylab_helpers import Gcf
    from matplotlib.backends import backend_webagg
    from tornado.iostream import StreamClosedError
    from tornado.websocket import WebSocketClosedError

    application: Any = backend_webagg.WebAggApplication
    closed = (WebSocketClosedError, StreamClosedError)

    class Page(application.WebSocket):  # type: ignore[misc]
        """A tab of a browser."""

        def write_message(self, message: Any, binary: bool = False) -> 'asyncio.Future[None]':
            try:
                sent: asyncio.Future[None] = super().write_message(message, binary)
            except closed:
                sent = asyncio.get_event_loop().create_future()
                sent.set_result(None)
            else:
                # Looked at, so that asyncio does not report it: the tab was closed while it was under way.
                sent.add_done_callback(lambda done: done.cancelled() or done.exception())
            return sent

        def open(self, fignum: str) -> None:
            if Gcf.get_fig_manager(int(fignum)) is None:
                self.close()
            else:
                super().open(fignum)

        def on_close(self) -> None:
            with contextlib.suppress(AttributeError, KeyError):  # it has never been opened, or the figure is closed
                super().on_close()

        def on_message(self, message: Any) -> None:
            with contextlib.suppress(ValueError, TypeError, KeyError, AttributeError, RecursionError):
                if isinstance(json.loads(message), dict):
                    super().on_message(message)

    if not isinstance(application.WebSocket, type) or application.WebSocket.__name__ != Page.__name__:
        application.WebSocket = Page
    # What remains is of the pages too: a connection that was reset, a request that is no HTTP.
    for name in ('tornado.general', 'tornado.access', 'tornado.application'):
        logging.getLogger(name).setLevel(logging.CRITICAL)

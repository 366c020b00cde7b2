"""Define Textual's driver for a browser, with our input parser."""

from textual.drivers._byte_stream import ByteStream
from textual.drivers.web_driver import WebDriver, _ExitInput

from ground.app.input.driver import InputReader

TYPED = "D"


class BrowserDriver(WebDriver):
    """Reads packets from the server: typed or pasted text, or news of the window."""

    def run_input_thread(self) -> None:
        """Read until the server sends the end."""
        reader, stream = InputReader(self.process_message), ByteStream()
        try:
            for data in self._input_reader:
                for kind, payload in stream.feed(data) if data else ():
                    if kind == TYPED:
                        reader.feed(payload)
                    else:
                        self._on_meta(kind, payload)
                reader.tick()
        except _ExitInput:
            pass
        finally:
            self._input_reader.close()

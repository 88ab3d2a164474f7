"""The process that owns the window: it alone talks to the display server.

A display server that dies takes its clients' processes with it, a driver may crash or block for ever in a swap, and
a window has to answer its events while the rig computes. All that happens here, and the rig stays alive. Started by
:class:`rig.devices.window.link.ScreenLink` as a script; imports nothing of the rig.

Messages are JSON objects, one a packet. The screen begins with ``{"monitors": [...]}`` and answers a request
``{"open": index}`` or ``{"show": true}`` with itself, or with ``{"problem": kind, "message": text}``; kind is missing,
failed, lost or refused. The picture lies in shared memory: rows from the bottom, 4 bytes a pixel. It ends, black,
when the rig hangs up or dies.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import mmap
import os
import select
import signal
import socket
import sys
import time
from dataclasses import dataclass, field
from typing import Any, TypeAlias

EVENT_PERIOD_MS = 20
"""Between two looks at the window's events."""
AWAKE_PERIOD_S = 10.0
SETTLE_S = 3.0
"""How long a window manager may take to give the window the whole monitor."""
_PACKET_BYTES = 1 << 16
_GONE = "it was unplugged or switched off; connect it and open the rig again"
Message: TypeAlias = dict[str, Any]
"""One JSON object, as it goes between the two processes."""


class ScreenProblem(Exception):
    """Something to tell the rig: a kind, and a message for its user."""

    def __init__(self, kind: str, message: str):
        super().__init__(message)
        self.kind = kind


@dataclass
class Display:
    """The connection to the display server, and the last thing that it complained of."""

    glfw: Any
    complaints: list[str] = field(default_factory=list)

    @classmethod
    def connect(cls) -> Display:
        """Connect to the display server that the environment names. Raises ScreenProblem."""
        os.environ.setdefault("PYGLFW_LIBRARY_VARIANT", "wayland" if os.environ.get("WAYLAND_DISPLAY") else "x11")
        try:
            import glfw
            import moderngl  # noqa: F401 - to miss it now, not at the first picture
        except ImportError as error:
            raise ScreenProblem("missing", str(error)) from error
        display = cls(glfw)
        glfw.set_error_callback(display.complain)
        if not glfw.init():
            raise ScreenProblem("failed", display.last_complaint())
        return display

    def complain(self, _: int, text: Any) -> None:
        """Keep what the display library complains of; most of it is harmless."""
        self.complaints.append(text.decode(errors="replace"))

    def last_complaint(self) -> str:
        """Return what went wrong last, in the display library's words."""
        return self.complaints[-1] if self.complaints else "no reason given"

    @property
    def knows_places(self) -> bool:
        """Whether windows know where they are; Wayland does not tell."""
        return bool(self.glfw.get_platform() != self.glfw.PLATFORM_WAYLAND)

    def stay_awake(self) -> None:
        """Put off the X server's screen saver and power saving. A full-screen window on Wayland does it by itself."""
        if self.knows_places:
            ctypes.CDLL("libX11.so.6").XResetScreenSaver(ctypes.c_void_p(self.glfw.get_x11_display()))

    def monitors(self) -> list[dict[str, object]]:
        """Every monitor's name, place and present mode, in the server's order."""
        return [self._monitor(index, monitor) for index, monitor in enumerate(self.glfw.get_monitors())]

    def mode(self, monitor: Any) -> Any:
        """A monitor's present mode. Raises ScreenProblem for one that went away just now."""
        try:
            return self.glfw.get_video_mode(monitor)
        except ValueError as error:  # the library's answer is a null pointer
            raise ScreenProblem("lost", _GONE) from error

    def _monitor(self, index: int, monitor: Any) -> dict[str, object]:
        (x_px, y_px), mode = self.glfw.get_monitor_pos(monitor), self.mode(monitor)
        return {
            "name": self.glfw.get_monitor_name(monitor).decode(errors="replace"),
            "index": index,
            "x_px": x_px,
            "y_px": y_px,
            "width_px": mode.size.width,
            "height_px": mode.size.height,
            "refresh_rate_hz": float(mode.refresh_rate),
        }


class Window:
    """A borderless window that fills one monitor in its present mode. Black until a picture is shown."""

    def __init__(self, display: Display, index: int):
        self._display, self._glfw = display, display.glfw
        monitors = self._glfw.get_monitors()
        if index >= len(monitors):
            raise ScreenProblem("lost", "it was switched off")
        mode = display.mode(monitors[index])
        self._awake_until_s = 0.0
        self._size = tuple(mode.size)
        self._place = tuple(self._glfw.get_monitor_pos(monitors[index]))
        self._window = self._create(monitors[index], mode)
        self._glfw.set_window_refresh_callback(self._window, lambda _: self._draw())
        self._make_canvas()
        self._settle()

    def _create(self, monitor: Any, mode: Any) -> Any:
        glfw = self._glfw
        hints = {
            glfw.AUTO_ICONIFY: False,
            glfw.FLOATING: True,
            glfw.REFRESH_RATE: mode.refresh_rate or glfw.DONT_CARE,
            glfw.RED_BITS: 8,
            glfw.GREEN_BITS: 8,
            glfw.BLUE_BITS: 8,
            glfw.ALPHA_BITS: 0,
            glfw.DEPTH_BITS: 0,
            glfw.STENCIL_BITS: 0,
            glfw.CONTEXT_VERSION_MAJOR: 3,
            glfw.CONTEXT_VERSION_MINOR: 3,
            glfw.OPENGL_PROFILE: glfw.OPENGL_CORE_PROFILE,
        }
        for hint, value in hints.items():
            glfw.window_hint(hint, value)
        window = glfw.create_window(*self._units(monitor), "procam-rig projector", monitor, None)
        if not window:
            raise ScreenProblem("failed", self._display.last_complaint())
        glfw.set_input_mode(window, glfw.CURSOR, glfw.CURSOR_HIDDEN)
        glfw.make_context_current(window)
        glfw.swap_interval(1)
        return window

    def _units(self, monitor: Any) -> tuple[int, ...]:
        """The window's size as the desktop counts it: a Wayland desktop with large text counts in larger units."""
        scales = (1, 1) if self._display.knows_places else self._glfw.get_monitor_content_scale(monitor)
        return tuple(round(pixels / scale) for pixels, scale in zip(self._size, scales, strict=True))

    def _make_canvas(self) -> None:
        import moderngl

        self._context = moderngl.create_context()
        self._texture = self._context.texture(self._size, 4)
        self._canvas = self._context.framebuffer([self._texture])
        self._canvas.clear()
        self._screen = self._context.detect_framebuffer()

    def _settle(self) -> None:
        """Draw black until the window fills the monitor."""
        until_s = time.monotonic() + SETTLE_S
        self._draw()
        while self._trouble() is not None and time.monotonic() < until_s:
            self._glfw.wait_events_timeout(EVENT_PERIOD_MS / 1000)
            self._draw()
        self.check()

    def show(self, picture: mmap.mmap) -> None:
        """Put a picture on the monitor; returns when it was presented. Raises ScreenProblem."""
        self.check()
        self._texture.write(picture)
        self._draw()
        self._draw()  # a swap may return before its picture was taken over, but not before the one before it was
        self.check()

    def black(self) -> None:
        """Put black on the monitor."""
        self._canvas.clear()
        self._draw()

    def check(self) -> None:
        """Answer the window's events. Raises ScreenProblem when it does not fill its monitor any more."""
        self._glfw.poll_events()
        if time.monotonic() >= self._awake_until_s:
            self._display.stay_awake()
            self._awake_until_s = time.monotonic() + AWAKE_PERIOD_S
        if self._trouble() is None:
            return
        self._glfw.poll_events()  # one that was switched off just now seemed to be moved, until its event came
        trouble = self._trouble()
        if trouble is not None:
            raise trouble

    def _trouble(self) -> ScreenProblem | None:
        glfw, window = self._glfw, self._window
        monitor = glfw.get_window_monitor(window)
        if not monitor:
            return ScreenProblem("lost", _GONE)
        if glfw.window_should_close(window):
            return ScreenProblem("lost", "its window was closed by somebody; open the rig again")
        if glfw.get_window_attrib(window, glfw.ICONIFIED):
            return ScreenProblem("lost", "its window was minimised by somebody; open the rig again")
        try:
            return self._wrong_mode(monitor) or self._wrong_size() or self._wrong_place(monitor)
        except ScreenProblem as problem:
            return problem

    def _wrong_mode(self, monitor: Any) -> ScreenProblem | None:
        mode = tuple(self._display.mode(monitor).size)
        if mode == self._size:
            return None
        text = f"its mode is now {_size(mode)}, it was {_size(self._size)}; set that mode again"
        return ScreenProblem("refused", text)

    def _wrong_size(self) -> ScreenProblem | None:
        drawn = tuple(self._glfw.get_framebuffer_size(self._window))
        if drawn == self._size:
            return None
        return ScreenProblem(
            "refused",
            f"the desktop gives a full-screen window {_size(drawn)} of the monitor's {_size(self._size)}: it scales, "
            "or fills another monitor; set that monitor's scale to 100 %",
        )

    def _wrong_place(self, monitor: Any) -> ScreenProblem | None:
        if not self._display.knows_places:
            return None
        expected = tuple(self._glfw.get_monitor_pos(monitor))
        place = tuple(self._glfw.get_window_pos(self._window))
        if place == expected == self._place:
            return None
        return ScreenProblem(
            "lost", f"its window is at {place}, the monitor at {expected}: somebody moved one; open the rig again"
        )

    def _draw(self) -> None:
        self._context.copy_framebuffer(self._screen, self._canvas)
        self._glfw.swap_buffers(self._window)
        self._context.finish()

    def destroy(self) -> None:
        """Take the window off the screen."""
        self._glfw.destroy_window(self._window)


def _size(size: tuple[int, ...]) -> str:
    return f"{size[0]} x {size[1]} px"


@dataclass
class Server:
    """Answers the rig's requests until it hangs up."""

    link: socket.socket
    memory: int
    """File descriptor of the picture."""
    parent: int = field(default_factory=os.getppid)

    def serve(self) -> None:
        """Serve one rig; whatever cannot be done is reported."""
        display = None
        try:
            display = Display.connect()
            self._serve_window(display)
        except ScreenProblem as problem:
            self._answer({"problem": problem.kind, "message": str(problem)})
        finally:
            if display is not None:
                display.glfw.terminate()

    def _serve_window(self, display: Display) -> None:
        self._answer({"monitors": display.monitors()})
        request = self._next_request(None)
        if request is None:
            return
        window = Window(display, request["open"])
        self._answer(request)
        picture = mmap.mmap(self.memory, 0)
        try:
            while (request := self._next_request(window)) is not None:
                window.show(picture)
                self._answer(request)
            window.black()
        except ScreenProblem as problem:
            window.destroy()
            self._answer({"problem": problem.kind, "message": str(problem)})
            self._next_request(None)  # the rig reads it as the answer to that

    def _next_request(self, window: Window | None) -> Message | None:
        """The rig's next request; None when it is gone. Answers the window's events meanwhile."""
        while os.getppid() == self.parent:
            if select.select([self.link], [], [], EVENT_PERIOD_MS / 1000)[0]:
                return self._receive()
            if window is not None:
                window.check()
        return None

    def _receive(self) -> Message | None:
        with contextlib.suppress(ConnectionResetError):
            packet = self.link.recv(_PACKET_BYTES)
            return json.loads(packet) if packet else None
        return None

    def _answer(self, message: Message) -> None:
        with contextlib.suppress(BrokenPipeError):
            self.link.send(json.dumps(message).encode())


def main() -> None:
    """Serve the rig on the two file descriptors that the command line names."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the rig decides when its window goes
    link, memory = (int(argument) for argument in sys.argv[1:])
    Server(socket.socket(fileno=link), memory).serve()


if __name__ == "__main__":
    main()

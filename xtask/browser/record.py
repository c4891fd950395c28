"""Films the page, for the top of README: a follower is watched, his leader dragged back and then removed, and what follows is
driven. The same build gives the same pictures: every one is taken when the page has come to rest.

    record.py FILE.gif
"""

import io
import os
import sys
from pathlib import Path

from PIL import Image, ImageDraw
from playwright.sync_api import sync_playwright

from play import FOLLOWER, LEADER, Play

# Pixels; seconds of a picture.
SIZE = (900, 620)
FRAME_S, PAUSE_S = 0.1, 1.6
# What the file may have, bytes: a page loads it at once.
LARGEST = 2_500_000
COLOURS = 96
ARROW = [(0, 0), (0, 17), (4, 13), (7, 20), (10, 19), (7, 12), (13, 12)]


class Film:
    """Pictures of a page, with the pointer, which a browser without a window does not draw."""

    def __init__(self, play):
        self.play, self.pointer, self.shots = play, None, []

    def take(self, seconds=FRAME_S):
        image = Image.open(io.BytesIO(self.play.page.screenshot())).convert("RGB")
        if self.pointer:
            corners = [(self.pointer[0] + x, self.pointer[1] + y) for x, y in ARROW]
            ImageDraw.Draw(image).polygon(corners, fill="black", outline="white", width=1)
        self.shots.append((image, seconds))

    def point(self, place, steps):
        """Moves the pointer there, with a picture of every step."""
        begin = self.pointer or place
        for i in range(1, steps + 1):
            self.pointer = tuple(a + (b - a) * i / steps for a, b in zip(begin, place, strict=True))
            self.play.page.mouse.move(*self.pointer)
            self.play.settle()
            self.take()

    def press(self, key, seconds=FRAME_S):
        self.play.press(key)
        self.take(seconds)

    def save(self, path):
        """As a GIF whose pictures share their colours, so that what does not move costs nothing."""
        some = [image for image, _ in self.shots[:: max(len(self.shots) // 8, 1)]]
        strip = Image.new("RGB", (SIZE[0], SIZE[1] * len(some)))
        for i, image in enumerate(some):
            strip.paste(image, (0, SIZE[1] * i))
        palette = strip.quantize(COLOURS, method=Image.Quantize.MEDIANCUT)
        first, *rest = [image.quantize(palette=palette, dither=Image.Dither.NONE) for image, _ in self.shots]
        times = [round(1000 * seconds) for _, seconds in self.shots]
        first.save(path, save_all=True, append_images=rest, duration=times, loop=0, optimize=True)


def act(film):
    play = film.play
    film.take(PAUSE_S)
    # The recording goes on a little, its forecasts with it.
    for _ in range(10):
        film.press(".")
    for _ in range(10):
        play.press(",")
    film.press("g")
    x, y = play.place(*play.known[LEADER])
    film.pointer = (x + 160, y + 110)
    film.point((x, y), 8)
    play.page.mouse.down()
    film.point(play.place(play.known[LEADER][0] - 10, play.known[LEADER][1]), 20)
    play.page.mouse.up()
    play.settle()
    film.take(PAUSE_S)
    film.press("Delete", PAUSE_S)
    play.page.locator("#road").focus()
    for _ in range(25):
        film.press(".")
    film.shots[-1] = (film.shots[-1][0], PAUSE_S)


def main():
    out = Path(sys.argv[1])
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ["GNP_CHROMIUM"], args=["--no-sandbox"])
        context = browser.new_context(viewport=dict(zip(("width", "height"), SIZE, strict=True)), color_scheme="light", reduced_motion="reduce")
        play = Play(context.new_page(), os.environ["GNP_URL"]).open()
        film = Film(play)
        act(film)
        if play.troubles or not play.forecast(FOLLOWER):
            sys.exit(f"the page is not as it should be: {play.troubles}")
        out.parent.mkdir(parents=True, exist_ok=True)
        film.save(out)
        browser.close()
    if out.stat().st_size > LARGEST:
        sys.exit(f"{out} has {out.stat().st_size} bytes, more than {LARGEST}")


if __name__ == "__main__":
    main()

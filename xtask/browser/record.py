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

from play import FOLLOWER, LEADER, LINK, TIME_S, Play

# Pixels; seconds of a picture.
SIZE = (900, 760)
FRAME_S, PAUSE_S = 0.1, 2.0
# The recording is played up to the moment that is held, steps of a frame.
LEAD = 10
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

    def say(self, words):
        """Puts a caption between the title and the buttons of the page."""
        caption = "words => { const e = document.querySelector('header .spacer'); e.textContent = words; e.style.textAlign = 'center'; e.style.fontWeight = 600; }"
        self.play.page.evaluate(caption, words)

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
    play, page = film.play, film.play.page
    # Of two films of one build one picture may not differ: how soon an answer came is left out.
    page.evaluate("document.getElementById('latency').hidden = true")
    play.press("m")
    film.say("What the model expects of a vehicle")
    film.take(PAUSE_S / 2)
    for _ in range(LEAD):
        film.press(".")
    film.say("What if the leader were 10 m nearer?")
    film.press("g")
    x, y = play.place(*play.known[LEADER])
    film.pointer = (x + 160, y + 110)
    film.point((x, y), 6)
    page.mouse.down()
    film.point(play.place(play.known[LEADER][0] - 10, play.known[LEADER][1]), 15)
    page.mouse.up()
    play.settle()
    film.take(1.5 * PAUSE_S)
    film.say("And if he were gone?")
    film.press("Delete", 1.5 * PAUSE_S)
    page.locator("#road").focus()
    film.say("What follows, driven on")
    for _ in range(25):
        # Two steps a picture: twice as fast as it happens.
        play.press(".")
        film.press(".")
    film.shots[-1] = (film.shots[-1][0], PAUSE_S)


def main():
    out = Path(sys.argv[1])
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=os.environ["GNP_CHROMIUM"], args=["--no-sandbox"])
        context = browser.new_context(viewport=dict(zip(("width", "height"), SIZE, strict=True)), color_scheme="light", reduced_motion="reduce")
        play = Play(context.new_page(), os.environ["GNP_URL"]).open(LINK.replace(f"t={TIME_S}", f"t={TIME_S - LEAD / 10:.1f}"))
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

"""The page of `play` as a person has it before them: opened, waited for, taken hold of; and the server's own answers beside it."""

import functools
import json
import urllib.request

ROAD = 0
# A moment of a real scene: who is behind whom there, and how much that matters, is checked by `test_whatif.py`.
RECORDING, TIME_S, FOLLOWER, LEADER = "us101-18_1", 8.1, "379", "372"
MOMENT = {"recording": RECORDING, "road": ROAD, "time_s": TIME_S}
LINK = f"#recording={RECORDING}&road={ROAD}&t={TIME_S}&watch={FOLLOWER}"

PATIENCE_S = 20
# From one point of a drawn path to the next.
EVERY_S = 0.2


def ask(url, path, body=None):
    """The answer as the API gives it: to a POST with a body, to a GET without."""
    data = None if body is None else json.dumps(body).encode()
    request = urllib.request.Request(url + path, data, {"Content-Type": "application/json"})
    with urllib.request.urlopen(request, timeout=PATIENCE_S) as answer:
        return json.load(answer)


class Play:
    """One page. `troubles` is what it must not do: errors, breaches of its policy, requests to others."""

    def __init__(self, page, url):
        self.page, self.url = page, url
        self.troubles, self.bodies = [], []
        page.on("console", lambda message: message.type == "error" and self.troubles.append(message.text))
        page.on("pageerror", lambda error: self.troubles.append(str(error)))
        page.on("request", self._asked)

    def _asked(self, request):
        if not request.url.startswith((self.url + "/", "data:", "blob:")):
            self.troubles.append(f"a request to {request.url}")
        if request.method == "POST":
            self.bodies.append((request.url.removeprefix(self.url), request.post_data_json))

    def open(self, link=LINK):
        self.page.goto(self.url + "/" + link)
        self.page.wait_for_selector("html[data-ready='1']", state="attached", timeout=PATIENCE_S * 1000)
        return self.settle()

    def settle(self):
        """Waits until what is shown is the answer to what was asked last."""
        wait = "ms => Promise.race([window.gnp.settled().then(() => true), new Promise((done) => setTimeout(() => done(false), ms))])"
        assert self.page.evaluate(wait, PATIENCE_S * 1000), f"the page did not come to rest within {PATIENCE_S} s"
        return self

    def forecast(self, vehicle=FOLLOWER):
        """The drawn path, m: [[x, y], ...]; None where there is none."""
        return self.page.evaluate("id => window.gnp.forecast(id)", vehicle)

    def where(self, vehicle):
        """Its centre in the window, pixels; None where it is not there."""
        return self.page.evaluate("id => window.gnp.where(id)", vehicle)

    def changes(self):
        return self.page.evaluate("window.gnp.changes()")

    def place(self, *metres):
        """Where a place of the road is in the window, pixels; while the follower is where he was."""
        scales, origin = self.page.evaluate("window.gnp.perMetre()"), self.where(FOLLOWER)
        x, y = (m - known for m, known in zip(metres, self.known[FOLLOWER], strict=True))
        return [origin[0] + x * scales[0], origin[1] - y * scales[1]]

    @functools.cached_property
    def known(self):
        """Places of vehicles of the moment as it is, m, by name."""
        answer = ask(self.url, "/v1/predict", {"scene": MOMENT})
        return {forecast["id"]: forecast["at"] for forecast in answer["forecasts"]}

    def drag_from(self, place, by, steps=8, drop=True):
        """As a mouse does: takes what is at `place`, m, and draws it by so many metres forward and to the left."""
        (x, y), to = self.place(*place), self.place(place[0] + by[0], place[1] + by[1])
        self.page.mouse.move(x, y)
        self.page.mouse.down()
        self.page.mouse.move(*to, steps=steps)
        if drop:
            self.page.mouse.up()
            self.settle()

    def drag(self, vehicle, by, **options):
        """Takes hold of a vehicle that is where it was and draws it."""
        self.drag_from(self.known[vehicle], by, **options)

    def press(self, *keys):
        for key in keys:
            self.page.keyboard.press(key)
        return self.settle()

    def text(self, name):
        """What the element of that id says."""
        return self.page.locator(f"#{name}").inner_text()

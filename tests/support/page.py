"""An HTML page as tests look at it."""

from html.parser import HTMLParser

VOID_TAGS = {"meta", "img", "br", "link", "input", "hr"}


class Page(HTMLParser):
    """Collects what the tests look at, and insists on closed tags in order."""

    def __init__(self, text):
        super().__init__()
        self.source = text
        self.open_tags, self.ids, self.images, self.links, self.loads, self.words = [], [], {}, [], [], []
        self.feed(text)
        self.close()
        assert not self.open_tags

    def handle_starttag(self, tag, attrs):
        values = dict(attrs)
        if tag not in VOID_TAGS:
            self.open_tags.append(tag)
        if "id" in values:
            self.ids.append(values["id"])
        if tag == "img":
            self.images[self.ids[-1].removeprefix("figure-")] = values
        if tag == "a":
            self.links.append(values["href"])
        self.loads += [values[key] for key in ("src", "srcset", "poster", "data") if key in values]
        assert tag not in {"iframe", "link", "object"}
        assert tag != "script" or "src" not in values

    def handle_endtag(self, tag):
        assert self.open_tags.pop() == tag

    def handle_data(self, data):
        if self.open_tags and self.open_tags[-1] not in {"style", "script"}:
            self.words.append(data)

    @property
    def text(self):
        return " ".join(" ".join(self.words).replace("\u00a0", " ").split())

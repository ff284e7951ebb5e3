"""The report as a browser shows it: it needs nothing but itself, its controls work, and it fits every screen."""

from __future__ import annotations

import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn

import numpy as np
import PIL.Image
import pytest

from compare.browser import Page, find_chromium
from compare.small_comparison import CAMERAS, SIZE, small_experiment
from isosample.compare import report as report_module
from isosample.compare.experiment import run_experiment
from isosample.compare.report import MOST_PICTURES, Picture, chosen_entries, render_report, write_report

if TYPE_CHECKING:
    from collections.abc import Iterator

    from isosample.compare.experiment import Outcome

pytestmark = pytest.mark.usefixtures("gl")

CHROMIUM = find_chromium()
needs_chromium = pytest.mark.skipif(
    CHROMIUM is None, reason="no Chromium here; on Debian: apt-get install chromium"
)
DESKTOP, PHONE = (1280, 900), (390, 844)
ARTIFACTS = Path(__file__).resolve().parents[2] / "test_artifacts"
OVERFLOWING = """[...document.querySelectorAll('main *')]
  .filter((one) => !one.closest('.scroll') && !one.closest('svg') && one.getClientRects().length
    && one.getBoundingClientRect().right > innerWidth + 0.5)
  .map((one) => one.outerHTML.slice(0, 80))"""
CUT_OFF = """[...document.querySelectorAll('.plot text')].filter((one) => {
  const [own, plot] = [one.getBoundingClientRect(), one.closest('svg').getBoundingClientRect()];
  return own.left < plot.left || own.right > plot.right || own.top < plot.top || own.bottom > plot.bottom;
}).map((one) => one.textContent)"""
CONTRASTS = """(() => {
  const light = (text) => {
    const parts = text.match(/[\\d.]+/g).slice(0, 3).map((one) => one / 255);
    const [r, g, b] = parts.map((one) => one <= 0.04045 ? one / 12.92 : ((one + 0.055) / 1.055) ** 2.4);
    return 0.2126 * r + 0.7152 * g + 0.0722 * b;
  };
  const paper = light(getComputedStyle(document.documentElement).backgroundColor);
  const against = (color) => (Math.max(light(color), paper) + 0.05) / (Math.min(light(color), paper) + 0.05);
  const texts = [...document.querySelectorAll(
    'h1, h2, h3, p:not(.tag), td, th, th span, small, dt, dd, figcaption, label')];
  const marks = [...document.querySelectorAll('.plot text, .plot [class^=f]')].map((one) => getComputedStyle(one).fill);
  return [Math.min(...texts.map((one) => against(getComputedStyle(one).color))),
          Math.min(...marks.filter((one) => one.startsWith('rgb(')).map(against))];
})()"""


@pytest.fixture(scope="module")
def outcome(gl: object) -> Outcome:
    """The small comparison."""
    return run_experiment(small_experiment())


@pytest.fixture(scope="module")
def report(outcome: Outcome, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of its report."""
    folder = tmp_path_factory.mktemp("report")
    write_report(outcome, folder, source="blob.npy", transfer_function="tf.json")
    return folder


@pytest.fixture(scope="module")
def page(report: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """A browser with nothing loaded yet."""
    assert CHROMIUM is not None
    with Page(CHROMIUM, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture
def opened(page: Page, report: Path) -> Page:
    """The report on a desktop, freshly loaded."""
    page.resize(*DESKTOP)
    page.open(report / "report.html")
    return page


def clip_right(page: Page) -> float:
    """How much of the left picture is cut away [%]."""
    style = page.ask("getComputedStyle(document.getElementById('left-layer')).clipPath")
    numbers = re.fullmatch(r"inset\(0(?:px)? ([\d.]+)%(?: 0(?:px)? 0(?:px)?)?\)", style)
    assert numbers is not None, style
    return float(numbers[1])


def slider(page: Page, name: str) -> str:
    return str(page.ask(f"document.getElementById('divider').getAttribute('aria-{name}')"))


def transforms(page: Page) -> set[str]:
    """How the pictures of all panes are moved."""
    return set(page.ask("[...document.querySelectorAll('.layer img')].map((one) => one.style.transform)"))


def picture_box(page: Page) -> tuple[float, float, float, float]:
    """Left, top, width and height of the pane with the divider."""
    box = page.ask(
        "(({left, top, width, height}) => [left, top, width, height])"
        "(document.getElementById('split').getBoundingClientRect())"
    )
    return (float(box[0]), float(box[1]), float(box[2]), float(box[3]))


@needs_chromium
def test_the_mouse_drags_the_divider(opened: Page) -> None:
    x, y = opened.centre("#divider span")
    left, _, width, _ = picture_box(opened)
    assert clip_right(opened) == pytest.approx(50.0)
    opened.drag((x, y), (left + 0.8 * width, y))
    assert clip_right(opened) == pytest.approx(20.0, abs=0.5)  # a pixel is 0.15 %
    assert int(slider(opened, "valuenow")) == 80
    assert slider(opened, "valuetext") == "80 % left"
    opened.drag((left + 0.8 * width, y), (left - 50.0, y))
    assert clip_right(opened) == 100.0


@needs_chromium
def test_keys_move_the_divider_within_its_ends(opened: Page) -> None:
    assert (slider(opened, "valuemin"), slider(opened, "valuemax")) == ("0", "100")
    opened.ask("document.getElementById('divider').focus()")
    for key, now in [
        ("ArrowRight", "52"),
        ("ArrowLeft", "50"),
        ("PageUp", "60"),
        ("Home", "0"),
        ("ArrowLeft", "0"),
        ("End", "100"),
    ]:
        opened.press(key)
        assert slider(opened, "valuenow") == now
        assert clip_right(opened) == pytest.approx(100.0 - float(now))


@needs_chromium
def test_a_finger_drags_the_divider(page: Page, report: Path) -> None:
    page.resize(*PHONE, touch=True)
    page.open(report / "report.html")
    x, y = page.centre("#divider span")
    left, _, width, _ = picture_box(page)
    page.swipe((x, y), (left + 0.25 * width, y))
    assert clip_right(page) == pytest.approx(75.0, abs=0.5)


@needs_chromium
def test_zoom_and_pan_are_the_same_in_all_pictures(opened: Page) -> None:
    assert transforms(opened) == {"translate(0%, 0%) scale(1)"}
    opened.ask("document.getElementById('closer').click()")
    assert transforms(opened) == {"translate(-25%, -25%) scale(1.5)"}  # about the middle
    opened.ask("document.getElementById('split').focus()")
    opened.press("ArrowRight")
    assert transforms(opened) == {"translate(-35%, -25%) scale(1.5)"}
    opened.centre("#split")
    left, top, width, height = picture_box(opened)
    start = (left + 0.25 * width, top + 0.25 * height)
    opened.drag(start, (start[0] + 0.2 * width, start[1]))
    (moved,) = transforms(opened)
    assert float(moved.split("(")[1].split("%")[0]) == pytest.approx(-15.0, abs=0.5)
    opened.press("0")
    assert transforms(opened) == {"translate(0%, 0%) scale(1)"}


@needs_chromium
def test_any_two_pictures_can_be_held_against_each_other(opened: Page, report: Path) -> None:
    document = json.loads((report / "results.json").read_text(encoding="utf-8"))
    name = document["entries"][0]["name"]
    opened.choose("left", name)
    opened.choose("camera", "1")
    figure = f".contact figure[data-name='{name}'][data-camera='1']"
    for kind, image in (("picture", "left-picture"), ("error", "left-map")):
        assert opened.ask(
            f"document.querySelector(\"{figure} .{kind}\").src === document.getElementById('{image}').src"
        )
    opened.ask("document.querySelector('input[value=difference]').click()")
    assert opened.ask(
        f"document.querySelector(\"{figure} .difference\").src === document.getElementById('left-map').src"
    )
    assert opened.ask(
        "[document.getElementById('error-scale').hidden, document.getElementById('difference-scale').hidden]"
    ) == [True, False]


@needs_chromium
def test_nothing_is_asked_of_the_network_and_nothing_fails(opened: Page, report: Path) -> None:
    opened.ask("document.getElementById('closer').click()")
    own = (report / "report.html").as_uri()
    assert [url[:80] for url in opened.requests if url != own and not url.startswith("data:")] == []
    assert own in opened.requests
    assert opened.problems == []


@needs_chromium
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_it_fits_the_screen_and_can_be_read(
    page: Page, report: Path, size: tuple[int, int], *, dark: bool
) -> None:
    page.resize(*size, dark=dark, touch=size == PHONE)
    page.open(report / "report.html")
    assert page.ask("document.documentElement.scrollWidth") == size[0]
    assert page.ask(OVERFLOWING) == []
    text, marks = page.ask(CONTRASTS)
    assert text >= 4.5  # WCAG 2.2, 1.4.3
    assert marks >= 3.0  # 1.4.11
    drawn = page.ask(
        "[...document.querySelectorAll('.plot text')].map((one) => one.getBoundingClientRect().height)"
    )
    assert min(drawn) >= 9.0  # CSS pixels, of the box of the smallest text of a plot
    assert page.ask(CUT_OFF) == []
    background = page.ask("getComputedStyle(document.documentElement).backgroundColor")
    assert (sum(map(int, re.findall(r"\d+", background)[:3])) < 150) == dark
    ARTIFACTS.mkdir(exist_ok=True)
    picture = ARTIFACTS / f"report-{size[0]}-{'dark' if dark else 'light'}.png"
    page.screenshot(picture)
    with PIL.Image.open(picture) as taken:
        assert taken.width == size[0]
        assert len(taken.getcolors(1 << 24) or []) > 1000  # not an empty page


@needs_chromium
def test_a_name_breaks_at_its_parts_where_it_breaks_at_all(
    page: Page, outcome: Outcome, tmp_path: Path
) -> None:
    lines = """[...document.querySelectorAll('h1')].map((one) => {
      const found = [];
      for (const part of one.childNodes) {
        if (part.nodeType !== Node.TEXT_NODE) continue;
        const range = document.createRange();
        range.selectNodeContents(part);
        found.push([part.textContent, range.getClientRects().length]);
      }
      return found;
    })[0]"""
    name = "HeadMRVolume_registered-to-atlas.nii.gz"
    results = outcome.results
    renamed = results.scene | {"volume": results.scene["volume"] | {"name": name}}
    write_report(replace(outcome, results=replace(results, scene=renamed)), tmp_path)
    page.resize(*PHONE, touch=True)
    page.open(tmp_path / "report.html")
    assert page.ask(lines) == [
        [part, 1] for part in ("HeadMRVolume_", "registered-", "to-", "atlas", ".nii", ".gz")
    ]
    assert page.ask("document.querySelector('h1').textContent") == name


@needs_chromium
def test_no_table_scrolls_sideways_on_a_page_of_1200_pixels(page: Page, report: Path) -> None:
    page.resize(1200, 900)
    page.open(report / "report.html")
    # A setting with a longer label than those of this report, as comparisons have them.
    page.ask(
        "document.querySelectorAll('tbody th').forEach((one) => { one.lastChild.textContent = 'tolerance 1/255' })"
    )
    widths = page.ask(
        "[...document.querySelectorAll('.scroll')].map((one) => [one.scrollWidth, one.clientWidth])"
    )
    assert len(widths) == 5
    errors = widths[2]  # the one with most columns
    assert errors[0] <= errors[1]


@needs_chromium
def test_marks_tell_their_values_by_pointer_and_by_keyboard(opened: Page) -> None:
    opened.ask("document.querySelector('.point').focus()")
    told = opened.ask("document.querySelector('.point').dataset.tip")
    assert opened.ask(
        "[document.getElementById('tip').textContent, document.getElementById('tip').hidden]"
    ) == [told, False]
    assert re.search(r"RMSE \d\.\d\de-\d\d, [\d.e+]+ ms", told)
    opened.ask("document.activeElement.blur()")
    assert opened.ask("document.getElementById('tip').hidden")


@needs_chromium
def test_everything_has_a_name_for_those_who_do_not_see_it(opened: Page) -> None:
    pictures = opened.ask(
        "[...document.querySelectorAll('img')].filter((one) => one.getClientRects().length).map((one) => one.alt)"
    )
    assert len(pictures) > 10
    assert all(pictures)
    plots = opened.ask(
        "[...document.querySelectorAll('svg.plot')].map((one) => one.getAttribute('aria-label'))"
    )
    assert len(plots) == 4
    assert all(plots)
    tree = opened.call("Accessibility.getFullAXTree")["nodes"]
    roles = ("slider", "button", "combobox", "radio", "image", "region")
    unnamed = [
        node["role"]["value"]
        for node in tree
        if not node.get("ignored")
        and node["role"]["value"] in roles
        and not node.get("name", {}).get("value")
    ]
    assert unnamed == []


def test_the_page_begins_with_the_verdict_and_has_all_numbers(report: Path) -> None:
    text = (report / "report.html").read_text(encoding="utf-8")
    document = json.loads((report / "results.json").read_text(encoding="utf-8"))
    places = [text.index(sentence) for sentence in document["verdict"]["sentences"]]
    assert places == sorted(places)
    assert places[-1] < text.index("<svg") < text.index("<table")
    for entry in document["entries"]:
        assert f"<td>{entry['summary']['rmse']:.2e}</td>" in text
        assert f"<td>{entry['summary']['ssim']:.5f}</td>" in text
    assert document["machine"]["driver"]["renderer"] in text


def test_the_page_names_no_address_outside_of_itself(report: Path) -> None:
    text = (report / "report.html").read_text(encoding="utf-8")
    script = re.compile(r"<script>(.*?)</script>", flags=re.DOTALL)
    addresses = re.findall(r"(?:\b(?:src|href)\s*=|\burl\()\s*[\"']?([^\"')\s>]+)", script.sub("", text))
    assert len(addresses) > 10
    assert [address[:80] for address in addresses if not address.startswith(("data:", "#"))] == []
    assert not any(re.search(r"https?:|\bfetch\b|\bimport\b", part) for part in script.findall(text))
    assert "default-src 'none'" in text  # the browser would refuse, too


def test_every_picture_is_a_file_of_the_right_size(report: Path, outcome: Outcome) -> None:
    for camera in range(1, len(CAMERAS) + 1):
        for name in outcome.pictures:
            for kind in ("", "_error", "_difference"):
                with PIL.Image.open(report / "pictures" / f"camera-{camera}_{name}{kind}.png") as picture:
                    assert picture.size == SIZE
        assert (report / "pictures" / f"camera-{camera}_reference.png").is_file()


def test_plots_are_files_that_stand_alone(report: Path) -> None:
    for name in ("error_against_time", "error_against_samples", "time_against_frames", "histogram"):
        root = ET.fromstring((report / f"{name}.svg").read_text(encoding="utf-8"))
        assert root.tag == "{http://www.w3.org/2000/svg}svg"
        assert root.get("aria-label")
        style = root.find("{http://www.w3.org/2000/svg}style")
        assert style is not None
        assert "prefers-color-scheme: dark" in (style.text or "")


def fewer(outcome: Outcome) -> Outcome:
    """The comparison with its first two entries, which reach none of its targets."""
    results = outcome.results
    return replace(
        outcome,
        results=replace(
            results, entries=results.entries[:2], settings=results.settings | {"targets": [1e-9]}
        ),
    )


def test_a_report_over_another_one_leaves_no_picture_and_no_plot_of_that(
    outcome: Outcome, tmp_path: Path
) -> None:
    write_report(outcome, tmp_path)
    own = ["pictures/camera-1_mine.png", "pictures/notes.png", "sketch.svg"]
    for name in own:
        (tmp_path / name).write_bytes(b"")
    write_report(fewer(outcome), tmp_path)
    names = [entry.name for entry in outcome.results.entries[:2]]
    stems = [f"camera-{camera}_{name}" for camera in (1, 2) for name in names]
    pictures = [f"{stem}{kind}.png" for stem in stems for kind in ("", "_error", "_difference")]
    pictures += [f"camera-{camera}_reference.png" for camera in (1, 2)]
    plots = [f"{name}.svg" for name in ("error_against_time", "error_against_samples", "histogram")]
    files = [*plots, "report.html", "results.json", "results.csv", *(f"pictures/{name}" for name in pictures)]
    found = [str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if path.is_file()]
    assert sorted(found) == sorted(files + own)


@pytest.mark.parametrize("last", ["_write_pictures", "render_report", "write_table", "write_results"])
def test_numbers_and_page_are_of_one_comparison_wherever_the_next_one_ends(
    outcome: Outcome, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, last: str
) -> None:
    def interrupted(*_: object) -> NoReturn:
        raise KeyboardInterrupt

    write_report(outcome, tmp_path)
    names = ("report.html", "results.json")
    before = [(tmp_path / name).read_bytes() for name in names]
    monkeypatch.setattr(report_module, last, interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_report(fewer(outcome), tmp_path)
    assert [(tmp_path / name).read_bytes() for name in names] == before


@pytest.mark.parametrize(
    ("fastest", "shown"),
    [
        (
            [0, 2, 5],
            5,
        ),  # by race, from the loosest to the strictest: the place of the winner among the entries
        ([0, 2, None], 2),
        ([None, None, None], 0),
    ],
)
def test_the_winner_at_the_smallest_error_stands_left_at_first(
    outcome: Outcome, fastest: list[int | None], shown: int
) -> None:
    document = outcome.results.to_dict()
    document["scene"] |= {"source": None, "transfer_function_source": None}
    names = [entry["name"] for entry in document["entries"]]
    document["verdict"]["races"] = [
        {
            "target": target,
            "fastest": {} if place is None else {"m": names[place], "n": names[1]},
            "seconds": {},
        }
        for target, place in zip((0.005, 0.002, 0.001), fastest, strict=True)
    ]
    pictures = [Picture("reference", "reference", "float64", 0, None, "", "", "")]
    pictures += [Picture(name, "m", "label", 0, 0.1, "", "", "") for name in names]
    page = render_report(document, {}, pictures)
    assert re.findall(r'<option value="([^"]+)" selected', page) == [names[shown], "reference"]


def test_of_many_settings_the_report_shows_some_from_the_first_to_the_last() -> None:
    entries: list[dict[str, Any]] = [{"method": "pre-integrated", "name": str(number)} for number in range(9)]
    names = [entry["name"] for entry in chosen_entries(entries, MOST_PICTURES)]
    assert names == ["0", "3", "5", "8"]
    assert [entry["name"] for entry in chosen_entries(entries[:2], MOST_PICTURES)] == ["0", "1"]
    assert np.unique(names).size == len(names)

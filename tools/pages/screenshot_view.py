"""Take a picture of the viewer's page in headless Chromium: a recording, or a live scene.

    python tools/pages/screenshot_view.py events.aedat4 docs/images/view.png
    python tools/pages/screenshot_view.py two-boxes view.png --live --wait 20 --theme light --spp 4
    python tools/pages/screenshot_view.py two-boxes view.png --live --truth depth,flow,ids --out run.h5

Needs the [view] extra and a program called chromium (or chromium-browser, google-chrome).
"""

from __future__ import annotations

import argparse
import asyncio
import base64
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import aiohttp

OFFLINE = ("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update")
# Without a GPU, WebGL needs Chromium's own software renderer.
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader")


def arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("source", help="an event file or, with --live, a scene")
    parser.add_argument("picture", type=Path)
    parser.add_argument("--live", action="store_true", help="the source is a scene: render it")
    parser.add_argument("--wait", type=float, default=5.0, help="seconds before the picture is taken")
    parser.add_argument("--size", default="1440x900")
    parser.add_argument("--theme", choices=("dark", "light"), default="dark")
    parser.add_argument("--settings", type=json.loads, default={}, help="such as '{\"decay\": true}'")
    parser.add_argument("--script", default="", help="JavaScript to run before the picture")
    chosen, chosen_options = parser.parse_known_args()
    chosen.options = chosen_options  # what is left is for clsim
    return chosen


def serve(chosen: argparse.Namespace) -> tuple[subprocess.Popen[str], str]:
    """Start clsim and wait for the sentence that tells where the page is."""
    loop = [] if "--truth" in chosen.options else ["--loop"]  # truth is of one pass
    command = ["live", *loop, "--view", "web"] if chosen.live else ["view"]
    process = subprocess.Popen(
        [sys.executable, "-m", "clsim", *command, chosen.source, "--port", "0", *chosen.options],
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    for line in process.stderr:
        if "watch at " in line:
            return process, line.split("watch at ")[1].strip()
        print(line, end="", file=sys.stderr)
    raise SystemExit("clsim ended before its page was there")


async def take(chosen: argparse.Namespace, url: str) -> None:
    chromium = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if chromium is None:
        raise SystemExit("chromium is not installed")
    width, height = map(int, chosen.size.split("x"))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser = await asyncio.create_subprocess_exec(
            *(chromium, "--headless=new", "--no-sandbox", "--remote-debugging-port=0", f"--user-data-dir={profile}"),
            *(*OFFLINE, *SOFTWARE_GL, f"--window-size={width},{height}", "about:blank"),
            stderr=asyncio.subprocess.DEVNULL,
        )
        try:
            await drive(Path(profile), chosen, url, width, height)
        finally:
            browser.terminate()
            await browser.wait()


async def drive(profile: Path, chosen: argparse.Namespace, url: str, width: int, height: int) -> None:
    """Speak Chrome's DevTools protocol: open the page, let it run, take the picture."""
    told = profile / "DevToolsActivePort"
    while not told.exists() or not told.read_text().strip():
        await asyncio.sleep(0.1)
    port = told.read_text().split()[0]
    async with aiohttp.ClientSession() as session:
        async with session.get(f"http://127.0.0.1:{port}/json") as answer:
            page = next(target for target in await answer.json() if target["type"] == "page")
        async with session.ws_connect(page["webSocketDebuggerUrl"], max_msg_size=0) as socket:

            async def call(method: str, **values: Any) -> dict[str, Any]:
                await socket.send_json({"id": 1, "method": method, "params": values})
                while True:
                    message = await socket.receive_json()
                    if message.get("method") == "Runtime.exceptionThrown":
                        print(message["params"]["exceptionDetails"], file=sys.stderr)
                    if message.get("id") == 1:
                        return dict(message["result"])

            settings = json.dumps(json.dumps({"theme": chosen.theme} | chosen.settings))
            await call("Runtime.enable")
            await call("Page.enable")
            await call(
                "Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False
            )
            script = f"localStorage.setItem('clsim', {settings})"
            await call("Page.addScriptToEvaluateOnNewDocument", source=script)
            await call("Page.navigate", url=url)
            await asyncio.sleep(chosen.wait)
            if chosen.script:
                await call("Runtime.evaluate", expression=chosen.script)
                await asyncio.sleep(1.0)
            picture = await call("Page.captureScreenshot", format="png")
            chosen.picture.write_bytes(base64.b64decode(picture["data"]))


def main() -> None:
    chosen = arguments()
    process, url = serve(chosen)
    try:
        asyncio.run(take(chosen, url))
    finally:
        process.terminate()
        process.wait()


if __name__ == "__main__":
    main()

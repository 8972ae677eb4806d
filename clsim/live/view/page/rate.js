// The event rate over time, ON upwards and OFF downwards: the whole recording, or the newest seconds of a stream.

import { perSecond, seconds } from "./text.js";

const LIVE_BINS = 480;
const LIVE_BIN_US = 5000;

export class Rate {
  constructor(panel, canvas, tip, onSeek) {
    Object.assign(this, { panel, canvas, tip });
    this.context = canvas.getContext("2d");
    this.clear();
    this.file = null;
    canvas.addEventListener("pointermove", (event) => {
      this.show(event.offsetX);
      if (event.buttons && this.file) onSeek(this.time(event.offsetX));
    });
    canvas.addEventListener("pointerdown", (event) => {
      if (!this.file) return;
      canvas.setPointerCapture(event.pointerId);
      onSeek(this.time(event.offsetX));
    });
    canvas.addEventListener("pointerleave", () => { tip.hidden = true; });
  }

  clear() {
    this.on = new Float64Array(LIVE_BINS);
    this.off = new Float64Array(LIVE_BINS);
    this.newest = 0; // number of the newest bin, since time 0
  }

  // Counts the events of a live stream.
  count(baseUs, nowUs, dt, y) {
    if (nowUs < (this.newest - LIVE_BINS) * LIVE_BIN_US) this.clear();
    const newest = Math.floor(nowUs / LIVE_BIN_US);
    for (let bin = Math.max(this.newest, newest - LIVE_BINS) + 1; bin <= newest; bin++) {
      this.on[bin % LIVE_BINS] = this.off[bin % LIVE_BINS] = 0;
    }
    this.newest = Math.max(this.newest, newest);
    for (let k = 0; k < dt.length; k++) {
      const bin = Math.floor((baseUs + dt[k]) / LIVE_BIN_US);
      if (bin > this.newest - LIVE_BINS && bin <= this.newest) (y[k] & 0x8000 ? this.on : this.off)[bin % LIVE_BINS]++;
    }
  }

  overview(file) {
    this.file = file.on.length ? file : null;
    this.panel.classList.toggle("seekable", this.file !== null);
  }

  // What is shown: begin, width of a bin, counts.
  series() {
    if (this.file) return { beginUs: this.file.begin_us, binUs: this.file.bin_us, on: this.file.on, off: this.file.off };
    const used = Math.min(LIVE_BINS, this.newest + 1);
    const first = this.newest - used + 1;
    const pick = (counts) => Array.from({ length: used }, (_, k) => counts[(first + k) % LIVE_BINS]);
    return { beginUs: first * LIVE_BIN_US, binUs: LIVE_BIN_US, on: pick(this.on), off: pick(this.off) };
  }

  get bins() { return this.file ? this.file.on.length : LIVE_BINS; }

  time(left) {
    const { beginUs, binUs } = this.series();
    const end = this.file ? this.file.end_us : Infinity;
    const share = Math.max(0, Math.min(1, left / this.canvas.clientWidth));
    return Math.min(end, beginUs + share * this.bins * binUs);
  }

  show(left) {
    const { beginUs, binUs, on, off } = this.series();
    const bin = Math.floor((this.time(left) - beginUs) / binUs);
    this.tip.hidden = !(bin >= 0 && bin < on.length);
    if (this.tip.hidden) return;
    const rate = (counts) => perSecond(counts[bin] / binUs * 1e6);
    this.tip.textContent = `${seconds(beginUs + bin * binUs)}   ON ${rate(on)}   OFF ${rate(off)}`;
    const most = this.canvas.clientWidth - this.tip.offsetWidth - 6;
    this.tip.style.left = `${Math.max(6, Math.min(most, left + 10))}px`;
  }

  draw(nowUs, windowUs, theme) {
    const { canvas, context } = this;
    const ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio) || canvas.height !== Math.round(height * ratio)) {
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
    }
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    const { beginUs, binUs, on, off } = this.series();
    const middle = Math.round(height / 2);
    context.fillStyle = theme.lineText;
    context.fillRect(0, middle, width, 1);
    if (!on.length) return;
    let peak = 1;
    for (let k = 0; k < on.length; k++) peak = Math.max(peak, on[k], off[k]);
    const step = width / this.bins, tall = (middle - 16) / peak, gap = step > 3 ? 1 : 0;
    for (const [counts, colour, up] of [[on, theme.onText, true], [off, theme.offText, false]]) {
      context.fillStyle = colour;
      for (let k = 0; k < counts.length; k++) {
        const bar = counts[k] * tall;
        if (bar > 0) context.fillRect(k * step, up ? middle - bar : middle + 1, Math.max(step - gap, 0.6), Math.max(bar, 0.5));
      }
    }
    const place = (us) => (us - beginUs) / (this.bins * binUs) * width;
    const head = Math.min(place(nowUs), width - 1), from = place(nowUs - windowUs);
    context.fillStyle = theme.window;
    context.fillRect(from, 0, Math.max(head - from, 1), height);
    context.fillStyle = theme.text;
    context.fillRect(Math.round(head), 0, 1, height);
    context.font = "11px system-ui, sans-serif";
    context.fillStyle = theme.soft;
    context.textBaseline = "top";
    context.fillText(`peak ${perSecond(peak / binUs * 1e6)}`, 10, 6);
    context.textBaseline = "bottom";
    context.fillText(seconds(beginUs), 10, height - 5);
    context.textAlign = "right";
    context.fillText(seconds(beginUs + this.bins * binUs), width - 10, height - 5);
    context.textAlign = "left";
  }
}

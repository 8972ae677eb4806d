// The event image: signed sums over a window that ends now, or sums that fade with age, through a table of colours. By
// cause, the colour is that of a pixel's newest event, and the number of its events makes it strong.

const DECAY_REACH = 5; // e^-5 of an event is less than one step of the colour table
export const CAUSE_LEVELS = 64; // colours for each cause in the table of causes

export class EventImage {
  constructor(canvas) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d", { alpha: false });
  }

  resize(width, height) {
    this.canvas.width = width;
    this.canvas.height = height;
    this.width = width;
    this.height = height;
    this.sums = new Float32Array(width * height);
    this.newest = new Uint8Array(width * height); // where there are events, the cause of the newest
    this.picture = this.context.createImageData(width, height);
    this.pixels = new Uint32Array(this.picture.data.buffer);
  }

  draw(store, nowUs, { windowUs, decay, full }, { table, byCause }) {
    const { sums, newest, pixels, width, height } = this;
    const { mask, t, x, y, sign, cause } = store;
    sums.fill(0);
    const from = store.at(nowUs - windowUs * (decay ? DECAY_REACH : 1));
    const to = store.at(nowUs + 1);
    for (let n = from; n < to; n++) {
      const i = n & mask;
      if (x[i] >= width || y[i] >= height) continue;
      const pixel = y[i] * width + x[i], weight = byCause ? 1 : sign[i];
      sums[pixel] += decay ? weight * Math.exp((t[i] - nowUs) / windowUs) : weight;
      newest[pixel] = cause[i];
    }
    const most = byCause ? CAUSE_LEVELS - 1 : 127, scale = most / full;
    for (let i = 0; i < sums.length; i++) {
      const value = sums[i] * scale;
      const rest = byCause ? CAUSE_LEVELS * newest[i] : 128;
      pixels[i] = table[rest + (value > most ? most : value < -most ? -most : Math.round(value))];
    }
    this.context.putImageData(this.picture, 0, 0);
    return to - from;
  }
}

// The event image: signed sums over a window that ends now, or sums that fade with age, through a table of colours.

const DECAY_REACH = 5; // e^-5 of an event is less than one step of the colour table

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
    this.picture = this.context.createImageData(width, height);
    this.pixels = new Uint32Array(this.picture.data.buffer);
  }

  draw(store, nowUs, { windowUs, decay, full }, colours) {
    const { sums, pixels, width, height } = this;
    const { mask, t, x, y, sign } = store;
    sums.fill(0);
    const from = store.at(nowUs - windowUs * (decay ? DECAY_REACH : 1));
    const to = store.at(nowUs + 1);
    for (let n = from; n < to; n++) {
      const i = n & mask;
      if (x[i] >= width || y[i] >= height) continue;
      sums[y[i] * width + x[i]] += decay ? sign[i] * Math.exp((t[i] - nowUs) / windowUs) : sign[i];
    }
    const scale = 127 / full;
    for (let i = 0; i < sums.length; i++) {
      const value = sums[i] * scale;
      pixels[i] = colours[128 + (value > 127 ? 127 : value < -127 ? -127 : Math.round(value))];
    }
    this.context.putImageData(this.picture, 0, 0);
    return to - from;
  }
}

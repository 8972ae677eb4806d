// Events as points in x, y and time, turned by mouse, touch or keys. The newest lie on the face nearest to the eye,
// which looks like the image; the past recedes behind it.

const MOST_POINTS = 250_000;
const HOME = { yaw: -0.92, pitch: 0.3, zoom: 1 };
const DISTANCE = 3.4;
const FILL = 0.86; // share of the panel that the box takes up at home
const HALF_TIME = 1.35; // half the length of the time axis; the longer side of the sensor is 2 · HALF_SIDE
const HALF_SIDE = 0.78;

const POINTS = `#version 300 es
layout(location = 0) in vec4 event; // x, y in sensor pixels, age 0…1 as 0…32767, number of its colour
uniform mat4 view;
uniform vec3 extent; // width, height [pixels], scale
uniform float size;
uniform vec3 colours[4];
out vec4 colour;
void main() {
  float age = event.z / 32767.0;
  vec3 place = vec3(${HALF_TIME} - 2.0 * age * ${HALF_TIME}, (0.5 * extent.y - event.y) * extent.z, (0.5 * extent.x - event.x) * extent.z);
  gl_Position = view * vec4(place, 1.0);
  gl_PointSize = clamp(size / gl_Position.w, 1.0, 12.0);
  colour = vec4(colours[int(event.w)], mix(0.85, 0.22, age));
}`;

const POINT_COLOURS = `#version 300 es
precision mediump float;
in vec4 colour;
uniform float density;
out vec4 result;
void main() {
  float edge = 1.0 - smoothstep(0.55, 1.0, length(2.0 * gl_PointCoord - 1.0));
  float alpha = colour.a * edge * density;
  result = vec4(colour.rgb * alpha, alpha);
}`;

const LINES = `#version 300 es
layout(location = 0) in vec3 place;
uniform mat4 view;
void main() { gl_Position = view * vec4(place, 1.0); }`;

const LINE_COLOURS = `#version 300 es
precision mediump float;
uniform vec4 colour;
out vec4 result;
void main() { result = vec4(colour.rgb * colour.a, colour.a); }`;

export class Cloud {
  constructor(canvas, labels, onTurn) {
    this.canvas = canvas;
    this.labels = labels;
    const gl = this.gl = canvas.getContext("webgl2", { antialias: true, alpha: true, premultipliedAlpha: true });
    if (!gl) return;
    this.points = program(gl, POINTS, POINT_COLOURS);
    this.lines = program(gl, LINES, LINE_COLOURS);
    this.data = new Int16Array(4 * MOST_POINTS);
    this.pointArray = gl.createVertexArray();
    gl.bindVertexArray(this.pointArray);
    this.pointBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.pointBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, this.data.byteLength, gl.DYNAMIC_DRAW);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 4, gl.SHORT, false, 8, 0);
    this.lineArray = gl.createVertexArray();
    gl.bindVertexArray(this.lineArray);
    this.lineBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lineBuffer);
    gl.enableVertexAttribArray(0);
    gl.vertexAttribPointer(0, 3, gl.FLOAT, false, 12, 0);
    this.home();
    this.listen(onTurn);
  }

  home() { Object.assign(this, HOME); }

  resize(width, height) {
    this.width = width;
    this.height = height;
    this.scale = 2 * HALF_SIDE / Math.max(width, height);
    if (!this.gl) return;
    const [t, y, x] = [HALF_TIME, height * this.scale / 2, width * this.scale / 2];
    const now = [[t, -y, -x], [t, y, -x], [t, y, x], [t, -y, x]];
    const past = now.map(([, b, c]) => [-t, b, c]);
    const edges = [];
    for (let k = 0; k < 4; k++) edges.push(now[k], now[(k + 1) % 4]);
    for (let k = 0; k < 4; k++) edges.push(past[k], past[(k + 1) % 4], now[k], past[k]);
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.lineBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(edges.flat()), gl.STATIC_DRAW);
    this.corners = [...now, ...past];
    this.marks = { now: [t, y + 0.1, 0], past: [-t, y + 0.1, x], x: [t, -y - 0.09, 0], y: [t, 0, -x - 0.09] };
  }

  listen(onTurn) {
    const { canvas } = this;
    const turn = (yaw, pitch, zoom) => {
      this.yaw += yaw;
      this.pitch = Math.max(-1.5, Math.min(1.5, this.pitch + pitch));
      this.zoom = Math.max(0.4, Math.min(8, this.zoom * zoom));
      onTurn();
    };
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons) turn(event.movementX * 0.008, event.movementY * 0.008, 1);
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      turn(0, 0, Math.exp(-event.deltaY * 0.001));
    }, { passive: false });
    canvas.addEventListener("dblclick", () => { this.home(); onTurn(); });
    const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    canvas.addEventListener("keydown", (event) => {
      if (!keys[event.key]) return;
      event.preventDefault();
      event.stopPropagation();
      turn(...keys[event.key], 1);
    });
  }

  draw(store, nowUs, depthUs, theme) {
    const { gl, canvas } = this;
    if (!gl || !this.width) return;
    const ratio = window.devicePixelRatio || 1;
    const [width, height] = [canvas.clientWidth, canvas.clientHeight].map((side) => Math.max(1, Math.round(side * ratio)));
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.BLEND);
    const view = this.view(width / height);
    const count = this.fill(store, nowUs, depthUs, theme.byCause);

    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.useProgram(this.lines);
    gl.bindVertexArray(this.lineArray);
    gl.uniformMatrix4fv(gl.getUniformLocation(this.lines, "view"), false, view);
    const colour = gl.getUniformLocation(this.lines, "colour");
    gl.uniform4f(colour, ...theme.line, 0.4);
    gl.drawArrays(gl.LINES, 8, 16);

    gl.useProgram(this.points);
    gl.bindVertexArray(this.pointArray);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.pointBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, this.data, 0, 4 * count);
    const at = (name) => gl.getUniformLocation(this.points, name);
    gl.uniformMatrix4fv(at("view"), false, view);
    gl.uniform3f(at("extent"), this.width, this.height, this.scale);
    gl.uniform1f(at("size"), height * 0.0046 * this.magnified);
    gl.uniform1f(at("density"), Math.max(0.5, Math.min(1, 16_000 / Math.max(1, count))));
    gl.uniform3fv(at("colours"), theme.points.flat());
    gl.drawArrays(gl.POINTS, 0, count);

    gl.useProgram(this.lines);
    gl.bindVertexArray(this.lineArray);
    gl.uniform4f(colour, ...theme.line, 1);
    gl.drawArrays(gl.LINES, 0, 8);
    this.label(view);
  }

  // Writes the events of the window into the vertex array; of too many, every n-th.
  fill(store, nowUs, depthUs, byCause) {
    const { data } = this;
    const { mask, t, x, y, sign, cause } = store;
    const from = store.at(nowUs - depthUs), to = store.at(nowUs + 1);
    const stride = Math.max(1, Math.ceil((to - from) / MOST_POINTS));
    let k = 0;
    for (let n = Math.ceil(from / stride) * stride; n < to; n += stride) { // the same events from picture to picture
      const i = n & mask;
      data[k++] = x[i];
      data[k++] = y[i];
      data[k++] = (nowUs - t[i]) / depthUs * 32767;
      data[k++] = byCause ? cause[i] : sign[i] > 0;
    }
    return k >> 2;
  }

  // The camera, moved so that the box stays in the middle, and as near as fills the panel at home.
  view(aspect) {
    const home = bounds(camera(HOME.yaw, HOME.pitch, aspect), this.corners);
    const scale = this.magnified = this.zoom * FILL * 2 / Math.max(home.width, home.height);
    const view = camera(this.yaw, this.pitch, aspect);
    const { u, v } = bounds(view, this.corners);
    for (let column = 0; column < 16; column += 4) {
      view[column] = scale * (view[column] - u * view[column + 3]);
      view[column + 1] = scale * (view[column + 1] - v * view[column + 3]);
    }
    return view;
  }

  label(view) {
    for (const [name, place] of Object.entries(this.marks)) {
      const [u, v] = project(view, place);
      const left = (u + 1) / 2 * this.canvas.clientWidth, top = (1 - v) / 2 * this.canvas.clientHeight;
      this.labels[name].style.transform = `translate(${left.toFixed(1)}px, ${top.toFixed(1)}px) translate(-50%, -50%)`;
    }
  }
}

// Projection · distance · pitch · yaw, by columns as WebGL wants it.
function camera(yaw, pitch, aspect) {
  const [sy, cy, sp, cp] = [Math.sin(yaw), Math.cos(yaw), Math.sin(pitch), Math.cos(pitch)];
  const near = 0.1, far = 30;
  const rotation = [[cy, 0, sy], [sp * sy, cp, -sp * cy], [-cp * sy, sp, cp * cy]];
  const depth = (far + near) / (near - far), shift = 2 * far * near / (near - far);
  const view = new Float32Array(16);
  for (let column = 0; column < 3; column++) {
    const [x, y, z] = rotation.map((row) => row[column]);
    view.set([x / aspect, y, z * depth, -z], 4 * column);
  }
  view.set([0, 0, -DISTANCE * depth + shift, DISTANCE], 12);
  return view;
}

function project(view, [x, y, z]) {
  const [u, v, , w] = [0, 1, 2, 3].map((row) => view[row] * x + view[4 + row] * y + view[8 + row] * z + view[12 + row]);
  return [u / w, v / w];
}

function bounds(view, places) {
  const seen = places.map((place) => project(view, place));
  const [[left, right], [bottom, top]] = [0, 1].map((k) => [Math.min(...seen.map((p) => p[k])), Math.max(...seen.map((p) => p[k]))]);
  return { u: (left + right) / 2, v: (bottom + top) / 2, width: right - left, height: top - bottom };
}

function program(gl, vertex, fragment) {
  const made = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(made, shader);
  }
  gl.linkProgram(made);
  return made;
}

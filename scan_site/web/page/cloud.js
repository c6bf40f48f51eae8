// SPDX-License-Identifier: GPL-3.0-or-later
// A scan as points in 3-D on the platform it will be printed on, in levels of detail. Needs /three.js (libjs-three).
"use strict";

const cloudView = (() => {
  const canvas = byId("cloud"), note = byId("cloud-note");
  let gl = null;  // renderer, scene, camera, ...
  let shape = null;  // of the picture that is shown: head, levels, quanta
  const pose = { azimuth: -0.9, height: 0.45, distance: 100 };
  const shown = [0, 1, 1, 1, 1];
  // Points that a frame bears, as the last frames showed.
  const pace = { points: 50000, wasMoving: false, restsAt: 0, last: 0, frames: [] };

  const vertex = `
    attribute vec4 position;
    attribute vec4 normal;
    uniform mat4 modelViewMatrix, projectionMatrix;
    uniform mat3 normalMatrix;
    uniform float grain, hasNormals;
    uniform vec3 colours[5];
    uniform float shown[5];
    varying vec3 colour;
    void main() {
      vec4 at = modelViewMatrix * vec4(position.xyz, 1.0);
      gl_Position = projectionMatrix * at;
      int kind = int(position.w + 0.5);
      vec3 base = colours[1];
      float visible = shown[1];
      if (kind == 2) { base = colours[2]; visible = shown[2]; }
      if (kind == 3) { base = colours[3]; visible = shown[3]; }
      if (kind == 4) { base = colours[4]; visible = shown[4]; }
      float light = 0.85;
      if (hasNormals > 0.5 && dot(normal.xyz, normal.xyz) > 0.01) {
        vec3 n = normalize(normalMatrix * normal.xyz);
        vec3 eye = normalize(-at.xyz);
        // The far side does not shine through the near one.
        if (dot(n, eye) < -0.05) visible = 0.0;
        light = 0.35 + 0.65 * max(0.0, dot(n, normalize(vec3(0.3, 0.5, 0.9))));
      }
      if (visible < 0.5) gl_Position = vec4(2.0, 2.0, 2.0, 1.0);
      colour = base * light;
      gl_PointSize = clamp(grain / -at.z, 1.0, 12.0);
    }`;
  const fragment = `
    precision mediump float;
    varying vec3 colour;
    void main() { gl_FragColor = vec4(colour, 1.0); }`;

  const paint = (name) => new THREE.Color(getComputedStyle(document.documentElement).getPropertyValue(name).trim());

  function setColours() {
    if (!gl) return;
    const c = ["--paper", "--measured", "--completed", "--doubtful", "--left-out"].map((n) => paint(n));
    gl.material.uniforms.colours.value = c.map((each) => new THREE.Vector3(each.r, each.g, each.b));
    gl.paper = c[0];
    gl.renderer.setClearColor(gl.paper, 1);
    if (!shape) gl.renderer.clear();
    gl.plate.material.color = paint("--plate");
    gl.cropBox.material.color = paint("--accent");
    gl.markBox.material.color = paint("--ink");
  }

  async function start() {
    await loadThree("the 3-D view needs the package libjs-three on the scan site's machine; all else works without it");
    if (gl) return;
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true });
    const scene = new THREE.Scene(), part = new THREE.Group();
    part.matrixAutoUpdate = false;
    const material = new THREE.RawShaderMaterial({ vertexShader: vertex, fragmentShader: fragment,
      uniforms: { grain: { value: 2 }, hasNormals: { value: 0 }, colours: { value: [] }, shown: { value: shown } } });
    const plate = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    const cropBox = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    const markBox = new THREE.LineSegments(new THREE.BufferGeometry(), new THREE.LineBasicMaterial());
    cropBox.visible = markBox.visible = false;
    const crop = new THREE.Group();
    crop.matrixAutoUpdate = false;
    crop.add(cropBox, markBox);
    plate.frustumCulled = cropBox.frustumCulled = markBox.frustumCulled = false;
    scene.add(part, plate, crop);
    const camera = new THREE.PerspectiveCamera(30, 1.5, 0.1, 1000);
    camera.up.set(0, 0, 1);
    gl = { renderer, scene, part, material, plate, crop, cropBox, markBox, camera };
    setColours();
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { setColours(); draw(); });
    new ResizeObserver(fitCanvas).observe(canvas);
    fitCanvas();
  }

  function fitCanvas() {
    const scale = Math.min(2, window.devicePixelRatio || 1), width = canvas.clientWidth, height = canvas.clientHeight;
    if (!gl || !width || !height) return;
    gl.renderer.setPixelRatio(scale);
    gl.renderer.setSize(width, height, false);
    gl.camera.aspect = width / height;
    gl.camera.updateProjectionMatrix();
    draw();
  }

  function read(bytes) {
    const head = new DataView(bytes);
    if (head.getUint32(0, true) !== 0x50434654 || head.getUint32(4, true) !== 1) throw new Error("the picture is of another release; load the page again");
    const [level, levels, first, count, total, normals] = [8, 12, 16, 20, 24, 28].map((at) => head.getUint32(at, true));
    return { level, levels, first, count, total, hasNormals: normals === 1, low: [32, 40, 48].map((at) => head.getFloat64(at, true)), step: head.getFloat64(56, true),
      places: new Uint16Array(bytes, 64, 4 * count), normals: normals ? new Int8Array(bytes, 64 + 8 * count, 4 * count) : null };
  }

  function clear() {
    if (!gl) return;
    for (const points of [...gl.part.children]) {
      gl.part.remove(points);
      points.geometry.dispose();
    }
  }

  // Levels one after the other: the first is a picture at once. `isWanted` says whether anybody still looks.
  async function load(base, picture, isWanted) {
    await start();
    let isFirst = true;
    for (let level = 0; level < picture.levels; level++) {
      const answer = await fetch(`${base}/levels/${level}?revision=${picture.revision}`);
      if (!isWanted()) return;
      if (answer.status === 409) return;  // a newer one is on its way
      if (!answer.ok) throw new Error((await answer.json()).error.what);
      const got = read(await answer.arrayBuffer());
      if (!isWanted()) return;
      if (isFirst) {
        clear();
        shape = { drawn: 0, low: got.low, step: got.step, total: got.total, hasNormals: got.hasNormals, sample: got.places, loaded: 0 };
        gl.material.uniforms.hasNormals.value = got.hasNormals ? 1 : 0;
      }
      isFirst = false;
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(got.places, 4));
      geometry.setAttribute("normal", new THREE.BufferAttribute(got.normals || new Int8Array(4 * got.count), 4, true));
      const points = new THREE.Points(geometry, gl.material);
      points.frustumCulled = false;
      points.userData = { first: got.first, count: got.count };
      gl.part.add(points);
      shape.loaded = got.first + got.count;
      note.textContent = `${shape.loaded.toLocaleString()} of ${shape.total.toLocaleString()} points shown`;
      placed();
      document.dispatchEvent(new CustomEvent("cloud-shown", { detail: { level, loaded: shape.loaded } }));
    }
  }

  let placing = null;
  // placing: { rotate: [x, y, z] degrees, mirror, scale(size) in mm a unit, machine: { width_mm, depth_mm, height_mm } }.
  function setPlacing(next) {
    placing = next;
    placed();
  }

  function turned() {
    const [x, y, z] = placing.rotate.map((d) => (d * Math.PI) / 180);
    const m = new THREE.Matrix4().makeRotationFromEuler(new THREE.Euler(x, y, z, "ZYX"));
    const s = { x: 1, y: 1, z: 1 };
    if (placing.mirror) s[placing.mirror] = -1;
    return m.multiply(new THREE.Matrix4().makeScale(s.x, s.y, s.z));
  }

  // Box of the turned scan in its own unit, of the points of the first level that were measured.
  function turnedBox(m) {
    const e = m.elements, low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity], q = shape.sample;
    for (let i = 0; i < q.length; i += 4) {
      if (q[i + 3] !== 1) continue;
      const x = shape.low[0] + shape.step * q[i], y = shape.low[1] + shape.step * q[i + 1], z = shape.low[2] + shape.step * q[i + 2];
      for (let k = 0; k < 3; k++) {
        const v = e[k] * x + e[4 + k] * y + e[8 + k] * z;
        if (v < low[k]) low[k] = v;
        if (v > high[k]) high[k] = v;
      }
    }
    return { low, high, size: high.map((v, k) => v - low[k]) };
  }

  function placed() {
    if (!gl || !shape || !placing) return;
    const m = turned(), box = turnedBox(m);
    const scale = placing.scale(box.size);
    const size = box.size.map((v) => v * scale);
    const machine = placing.machine || { width_mm: size[0], depth_mm: size[1], height_mm: size[2] };
    const middle = [0, 1].map((k) => (box.low[k] + box.high[k]) / 2);
    const move = new THREE.Matrix4().makeTranslation(machine.width_mm / 2 - scale * middle[0], machine.depth_mm / 2 - scale * middle[1], -scale * box.low[2]);
    const toBuild = move.multiply(new THREE.Matrix4().makeScale(scale, scale, scale)).multiply(m);
    const quantum = new THREE.Matrix4().makeTranslation(...shape.low).multiply(new THREE.Matrix4().makeScale(shape.step, shape.step, shape.step));
    gl.part.matrix.copy(toBuild.clone().multiply(quantum));
    gl.crop.matrix.copy(toBuild);
    gl.part.matrixWorldNeedsUpdate = gl.crop.matrixWorldNeedsUpdate = true;
    setPlate(machine, size);
    const largest = Math.max(...size);
    if (!shape.view || Math.abs(shape.view / largest - 1) > 0.5) {
      shape.view = largest;
      pose.distance = 3 * largest;
    }
    shape.size = size;
    shape.machine = machine;
    // Points touch each other where they are spread evenly over a box.
    const area = 2 * (size[0] * size[1] + size[1] * size[2] + size[2] * size[0]);
    shape.grain = 1.6 * Math.sqrt(area / Math.max(1, shape.loaded));
    document.dispatchEvent(new CustomEvent("cloud-placed", { detail: { size } }));
    draw();
  }

  function setPlate(machine, size) {
    const { width_mm: w, depth_mm: d } = machine, lines = [];
    // A rounded 10 mm grid, at most 40 lines a side.
    const step = 10 * Math.max(1, Math.ceil(Math.max(w, d) / 400));
    for (let x = 0; x < w; x += step) lines.push(x, 0, 0, x, d, 0);
    for (let y = 0; y < d; y += step) lines.push(0, y, 0, w, y, 0);
    lines.push(w, 0, 0, w, d, 0, 0, d, 0, w, d, 0);
    gl.plate.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(lines), 3));
  }

  // Both in the frame of the file: the box that is cropped to, and that of a piece that is pointed at.
  const setCrop = (box) => gl && setBox(gl.cropBox, box);
  const setMark = (box) => gl && setBox(gl.markBox, box);
  function setBox(lines, box) {
    lines.visible = Boolean(box);
    if (box) {
      const [x0, y0, z0, x1, y1, z1] = box, c = [];
      for (const [y, z] of [[y0, z0], [y1, z0], [y0, z1], [y1, z1]]) c.push(x0, y, z, x1, y, z);
      for (const [x, z] of [[x0, z0], [x1, z0], [x0, z1], [x1, z1]]) c.push(x, y0, z, x, y1, z);
      for (const [x, y] of [[x0, y0], [x1, y0], [x0, y1], [x1, y1]]) c.push(x, y, z0, x, y, z1);
      lines.geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(c), 3));
    }
    draw();
  }

  let isAsked = false, isStale = false;
  function ask() {
    if (isAsked) return;
    isAsked = true;
    requestAnimationFrame(render);
  }
  function draw() {
    if (!gl) return;
    isStale = true;
    ask();
  }

  // Points first to end, on top of what is there.
  function drawPoints(first, end, grain) {
    for (const points of gl.part.children) {
      const from = Math.max(0, first - points.userData.first), to = Math.min(points.userData.count, end - points.userData.first);
      points.geometry.setDrawRange(from, Math.max(0, to - from));
      points.visible = to > from;
    }
    gl.material.uniforms.grain.value = grain;
    gl.renderer.render(gl.scene, gl.camera);
  }

  function aim() {
    const { machine, size } = shape, target = new THREE.Vector3(machine.width_mm / 2, machine.depth_mm / 2, size[2] / 2);
    const c = Math.cos(pose.height), largest = Math.max(...size, machine.width_mm, machine.depth_mm);
    gl.camera.position.set(target.x + pose.distance * c * Math.cos(pose.azimuth), target.y + pose.distance * c * Math.sin(pose.azimuth), target.z + pose.distance * Math.sin(pose.height));
    gl.camera.near = pose.distance / 100;
    gl.camera.far = pose.distance + 4 * largest;
    gl.camera.updateProjectionMatrix();
    gl.camera.lookAt(target);
  }

  // While the view moves as many points are drawn as a frame bears; once it rests the others are added, some a frame, so
  // that nobody waits for a million points before the next turn.
  function render(now) {
    isAsked = false;
    if (!gl || !shape || !shape.size) return;
    const height = canvas.clientHeight * gl.renderer.getPixelRatio();
    const grain = (count) => (shape.grain * Math.sqrt(shape.loaded / Math.max(1, count)) * height) / (2 * Math.tan(Math.PI / 12));
    if (isStale) {
      if (pace.wasMoving && now < pace.restsAt) {
        const took = now - pace.last;
        pace.frames.push(took);
        if (pace.frames.length > 120) pace.frames.shift();
        pace.points = Math.round(Math.max(10000, Math.min(shape.total, pace.points * Math.max(0.4, Math.min(1.15, 24 / took)))));
      }
      pace.wasMoving = now < pace.restsAt;
      pace.last = now;
      isStale = false;
      aim();
      const count = Math.min(pace.points, shape.loaded);
      gl.renderer.autoClear = true;
      gl.scene.background = gl.paper;
      gl.plate.visible = true;
      drawPoints(0, count, grain(count));
      shape.drawn = count;
    } else if (shape.drawn < shape.loaded && now >= pace.restsAt) {
      pace.wasMoving = false;
      const end = Math.min(shape.loaded, shape.drawn + pace.points);
      gl.renderer.autoClear = false;
      gl.scene.background = null;
      gl.plate.visible = false;
      drawPoints(shape.drawn, end, grain(shape.loaded));
      shape.drawn = end;
    }
    if (shape.drawn < shape.loaded) ask();
  }

  function move(azimuth, height, zoom = 1) {
    pose.azimuth += azimuth;
    pose.height = Math.max(-1.5, Math.min(1.5, pose.height + height));
    if (shape?.size) pose.distance = Math.max(Math.max(...shape.size) / 5, Math.min(Math.max(...shape.size) * 30, pose.distance * zoom));
    pace.restsAt = performance.now() + 250;
    draw();
  }

  // One finger or the mouse turns the view, two come nearer; with Shift the part is turned.
  const fingers = new Map();
  canvas.onpointerdown = (e) => {
    canvas.setPointerCapture(e.pointerId);
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
  };
  canvas.onpointerup = canvas.onpointercancel = (e) => fingers.delete(e.pointerId);
  const apart = () => {
    const [a, b] = [...fingers.values()];
    return Math.hypot(a[0] - b[0], a[1] - b[1]);
  };
  canvas.onpointermove = (e) => {
    const before = fingers.get(e.pointerId);
    if (!before) return;
    const was = fingers.size === 2 ? apart() : 0, dx = e.clientX - before[0], dy = e.clientY - before[1];
    fingers.set(e.pointerId, [e.clientX, e.clientY]);
    if (fingers.size === 2) move(0, 0, was / Math.max(1, apart()));
    else if (e.shiftKey) place.turnBy("z", dx / 2, "x", dy / 2, pose.azimuth);
    else move(-dx / 150, dy / 150);
  };
  canvas.addEventListener("wheel", (e) => { e.preventDefault(); move(0, 0, Math.exp(e.deltaY / 800)); }, { passive: false });
  const keys = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1], "+": [0, 0, 0.9], "-": [0, 0, 1.1] };
  const turns = { ArrowLeft: ["z", -5], ArrowRight: ["z", 5], ArrowUp: ["x", -5], ArrowDown: ["x", 5] };
  canvas.onkeydown = (e) => {
    if (!keys[e.key]) return;
    e.preventDefault();
    if (e.shiftKey && turns[e.key]) place.turnBy(...turns[e.key]);
    else move(...keys[e.key]);
  };
  for (const box of document.querySelectorAll("[data-kind]"))
    box.onchange = () => {
      shown[Number(box.dataset.kind)] = box.checked ? 1 : 0;
      draw();
    };

  return { load, setPlacing, setCrop, setMark, clear: () => { clear(); shape = null; note.textContent = ""; if (gl) gl.renderer.clear(); }, move, pace, size: () => shape?.size, isWhole: () => Boolean(shape && shape.drawn === shape.total),
    box: () => shape && { low: shape.low, high: shape.low.map((v) => v + 65535 * shape.step) }, note };
})();

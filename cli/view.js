// SPDX-License-Identifier: Apache-2.0
// The live view: a camera that keys and gestures move, pictures that splatguard draws for it, and what a training says.
'use strict';
const $ = id => document.getElementById(id);
const canvas = $('canvas'), context = canvas.getContext('2d');
const COLOUR = 0, DIFFERENCE = 3, PHOTO = 4, SCORE = 5;

// ---- vectors; a camera is {R: world to camera, rows right, down, forward; c: its place} ----
const add = (a, b, s = 1) => a.map((v, i) => v + s * b[i]);
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const length = a => Math.hypot(...a);
const unit = a => { const n = length(a) || 1; return a.map(v => v / n); };

function fromQuaternion([a, b, d, e]) {
    return [[1 - 2 * (d * d + e * e), 2 * (b * d - a * e), 2 * (b * e + a * d)],
        [2 * (b * d + a * e), 1 - 2 * (b * b + e * e), 2 * (d * e - a * b)],
        [2 * (b * e - a * d), 2 * (d * e + a * b), 1 - 2 * (b * b + d * d)]];
}

function toQuaternion(R) {
    const [[a, b, c], [d, e, f], [g, h, i]] = R;
    const rows = [[1 + a + e + i, h - f, c - g, d - b], [h - f, 1 + a - e - i, b + d, c + g],
        [c - g, b + d, 1 - a + e - i, f + h], [d - b, c + g, f + h, 1 - a - e + i]];
    const best = [0, 1, 2, 3].reduce((k, j) => rows[j][j] > rows[k][k] ? j : k);
    return unit(rows[best]);
}

// A vector turned around an axis (Rodrigues).
function turned(v, axis, angle) {
    const s = Math.sin(angle), c = Math.cos(angle);
    return add(add(v.map(x => x * c), cross(axis, v), s), axis, dot(axis, v) * (1 - c));
}

function cameraOf(view) {
    const R = fromQuaternion(view.q);
    return {R, c: [0, 1, 2].map(k => -(R[0][k] * view.t[0] + R[1][k] * view.t[1] + R[2][k] * view.t[2]))};
}

// ---- state ----
let scene, camera, up, view = 0, atPhoto = true;
let middle, pivot; // of the scene; what the camera turns about, which panning takes along
let render = null, photo = null, photoView = -1, scored = -1; // scored: the newest picture of scores

// Where the axes of all cameras come nearest to each other; before the camera where they are parallel.
function findMiddle() {
    const cameras = scene.views.map(cameraOf);
    const far = 1.5 * scene.extent;
    up = unit(cameras.reduce((sum, c) => add(sum, c.R[1], -1), [0, 0, 0]));
    if (length(up) < .5) up = [0, -1, 0];
    middle = add(cameras[0].c, cameras[0].R[2], far);
    if (cameras.length < 2) return;
    const M = [[1e-9, 0, 0], [0, 1e-9, 0], [0, 0, 1e-9]], b = [0, 0, 0];
    for (const {R, c} of cameras)
        for (let i = 0; i < 3; i++)
            for (let j = 0; j < 3; j++) {
                const v = (i === j) - R[2][i] * R[2][j];
                M[i][j] += v, b[i] += v * c[j];
            }
    const det = dot(M[0], cross(M[1], M[2]));
    const solved = [cross(M[1], M[2]), cross(M[2], M[0]), cross(M[0], M[1])];
    const p = [0, 1, 2].map(k => (solved[0][k] * b[0] + solved[1][k] * b[1] + solved[2][k] * b[2]) / det);
    if (det > 1e-3 * cameras.length ** 3 && p.every(Number.isFinite)) middle = p;
}

const kind = () => +$('kind').value;
const orbits = () => $('mode').value === 'orbit';

// ---- pictures ----
function address(of, scale, still) {
    const [w, x, y, z] = toQuaternion(camera.R), t = camera.R.map(row => -dot(row, camera.c));
    return `picture?kind=${of}&view=${view}&scale=${scale}&still=${still}&qw=${w}&qx=${x}&qy=${y}&qz=${z}&tx=${t[0]}&ty=${t[1]}&tz=${t[2]}`;
}

async function fetchPicture(of, scale, still) {
    const answer = await fetch(address(of, scale, still));
    if (!answer.ok) throw new Error((await answer.text()).trim());
    return createImageBitmap(await answer.blob());
}

// The next picture; what the last one holds is not left to the garbage collector, which sees little of it.
function replace(last, next) {
    if (last !== next) last?.close?.();
    return next;
}

// ---- drawn by the browser, where it can ----
let drawing = null;  // what view_draw.js has opened
let trouble = '';    // why it has not

function drawnHere() {
    return drawing && kind() === COLOUR && $('by').value === 'browser';
}

async function openDrawing() {
    const began = performance.now();
    try {
        const {openDrawing} = await import('./draw.js');
        drawing = await openDrawing(scene, () => drawnHere() && draw(false), () => leaveDrawing('its GPU is gone'));
        for (const e of document.querySelectorAll('.browser')) e.hidden = false;
        canvas.dataset.loaded = Math.round(performance.now() - began);
        draw(false);
    } catch (error) {
        leaveDrawing(error.message || error);
    }
}

function leaveDrawing(why) {
    drawing = null;
    canvas.dataset.loaded = 'failed';
    for (const e of document.querySelectorAll('.browser')) e.hidden = true;
    trouble = `The browser cannot draw the model: ${why}. splatguard draws it.`;
    draw(false);
}

// One request at a time: a small JPEG while the camera moves, an exact PNG when it rests.
let wanted = false, moving = 0, busy = false;
function draw(moves) {
    moving = moves ? performance.now() : 0;
    wanted = true;
    if (!busy) work();
}

async function work() {
    busy = true;
    while (wanted) {
        wanted = false;
        const fast = moving > 0, of = scene.model ? kind() : PHOTO;
        try {
            if (scene.photos && (photoView !== view) && (of === PHOTO || +$('wipe').value > 0)) {
                const asked = view; // another one may be chosen while this one comes
                photo = replace(photo, await fetchPicture(PHOTO, 1, 1));
                photoView = asked;
            }
            if (drawnHere()) {
                await drawing.frame(camera, scene.views[view], ...size());
                if (drawing.any) render = replace(render, drawing.canvas);
            } else if (of !== PHOTO) {
                if (of >= SCORE && scored !== of) show('Counting hits in the training views …');
                const width = (canvas.clientWidth || 300) * devicePixelRatio;
                const fit = Math.min(1, Math.max(.05, width / scene.views[view].width));
                render = replace(render, await fetchPicture(of, fast ? Math.max(.05, fit / 2) : fit, fast ? 0 : 1));
                if (of >= SCORE) scored = of;
            }
            show('');
        } catch (error) {
            show('No picture: ' + error.message, true);
            await new Promise(done => setTimeout(done, 500));
        }
        paint();
        if (fast && !wanted && !drawnHere()) {
            await new Promise(done => setTimeout(done, 150));
            if (!wanted) wanted = true, moving = 0;
        }
    }
    busy = false;
    canvas.dataset.drawn = +(canvas.dataset.drawn || 0) + 1;
}

function size() {
    const {width, height} = scene.views[view];
    const w = Math.min(width, Math.max(64, Math.round(canvas.clientWidth * devicePixelRatio)));
    return [w, Math.max(1, Math.round(w * height / width))];
}

function paint() {
    const of = scene.model ? kind() : PHOTO, picture = of !== PHOTO ? render : photoView === view ? photo : null, [w, h] = size();
    if (canvas.width !== w || canvas.height !== h) canvas.width = w, canvas.height = h;
    if (!picture) return context.clearRect(0, 0, w, h);
    context.drawImage(picture, 0, 0, w, h);
    const edge = Math.round(w * $('wipe').value / 100);
    if (edge && photoView === view && of !== PHOTO) {
        context.save();
        context.beginPath();
        context.rect(0, 0, edge, h);
        context.clip();
        context.drawImage(photo, 0, 0, w, h);
        context.restore();
        context.fillStyle = '#fff';
        context.fillRect(edge - 1, 0, 2, h);
    }
}

function explain() {
    const next = scene.training ? 'what the next pass of the defense\'s filter removes, if nothing changes before it' :
        'the 3 % with the lowest scores, which a pass of the defense\'s filter would remove';
    const texts = {5: 'Yellow: the lowest scores, which the defense\'s filter removes first. Violet: the highest.',
        6: 'Yellow: Gaussians in the fewest pixels of training views. Violet: in the most.', 7: `Red: ${next}.`};
    $('legend').textContent = texts[kind()] || '';
    $('legend').hidden = !texts[kind()];
}

function show(text, bad) {
    explain();
    $('message').textContent = text || trouble || (atPhoto || !scene.photos ? '' : 'The camera has left the photo: difference and wipe compare different places.');
    $('message').classList.toggle('bad', !!bad);
}

// ---- the camera ----
function moved() {
    atPhoto = false;
    draw(true);
}

// To where the keys point; around the middle, the near side goes there. The tilt comes first: about an axis that
// has turned it would roll the camera.
function turn(right, down) {
    const around = orbits() ? pivot : camera.c;
    for (const [axis, angle] of [[camera.R[0], -down], [up, -right]]) {
        camera.R = camera.R.map(row => unit(turned(row, axis, angle)));
        camera.c = add(around, turned(add(camera.c, around, -1), axis, angle));
    }
    moved();
}

function step(x, y, z) {
    const far = orbits() ? Math.max(length(add(pivot, camera.c, -1)), .05 * scene.extent) : scene.extent;
    [x, y, z].forEach((v, k) => {
        const by = camera.R[k].map(r => r * v * far);
        camera.c = add(camera.c, by);
        if (orbits() && k < 2) pivot = add(pivot, by);
    });
    moved();
}

function jump(to) {
    view = (to + scene.views.length) % scene.views.length;
    $('photo').value = view;
    camera = cameraOf(scene.views[view]);
    pivot = middle;
    atPhoto = true;
    canvas.setAttribute('aria-label', `The model from the camera of ${scene.views[view].name || 'the page'}; keys move it`);
    draw(false);
}

const keys = {
    ArrowLeft: () => turn(-.06, 0), ArrowRight: () => turn(.06, 0), ArrowUp: () => turn(0, -.06), ArrowDown: () => turn(0, .06),
    w: () => step(0, 0, .06), s: () => step(0, 0, -.06), a: () => step(-.04, 0, 0), d: () => step(.04, 0, 0),
    q: () => step(0, -.04, 0), e: () => step(0, .04, 0), '[': () => jump(view - 1), ']': () => jump(view + 1),
    r: () => jump(view), m: () => { $('mode').selectedIndex ^= 1; }, p: () => scene.training && $('pause').click(),
    ',': () => wipe(-5), '.': () => wipe(5), b: () => {
        $('by').selectedIndex ^= 1;
        draw(false);
    }
};

function wipe(by) {
    $('wipe').value = +$('wipe').value + by;
    draw(false);
}

addEventListener('keydown', event => {
    const inField = ['SELECT', 'INPUT'].includes(event.target.tagName); // a button takes Enter and the space bar, no key of ours
    if (!scene || event.ctrlKey || event.altKey || event.metaKey || inField) return;
    const key = event.key.length === 1 ? event.key.toLowerCase() : event.key;
    if (key >= '1' && key <= '8') {
        const option = $('kind').options[key - 1];
        if (!option || option.disabled) return;
        $('kind').selectedIndex = key - 1;
        draw(false);
    } else if (keys[key]) keys[key]();
    else return;
    event.preventDefault();
});

const fingers = new Map();
canvas.addEventListener('pointerdown', event => {
    if (event.button) return;
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, event);
});
for (const end of ['pointerup', 'pointercancel', 'lostpointercapture'])
    canvas.addEventListener(end, event => fingers.delete(event.pointerId));
canvas.addEventListener('pointermove', event => {
    const before = fingers.get(event.pointerId);
    if (!before || !scene) return;
    const spread = () => {
        const [a, b] = [...fingers.values()];
        return Math.hypot(a.clientX - b.clientX, a.clientY - b.clientY);
    };
    const x = (event.clientX - before.clientX) / canvas.clientWidth, y = (event.clientY - before.clientY) / canvas.clientWidth;
    const wide = fingers.size === 2 ? spread() : 0;
    fingers.set(event.pointerId, event);
    if (fingers.size === 2) step(0, 0, (spread() - wide) / canvas.clientWidth);
    else if (event.shiftKey) step(-x, -y, 0);
    else turn(3 * x, 3 * y);
});
canvas.addEventListener('wheel', event => {
    event.preventDefault();
    if (scene) step(0, 0, -.001 * Math.max(-200, Math.min(200, event.deltaY)));
}, {passive: false});

// ---- training ----
const count = v => v === null ? '–' : Math.round(v).toLocaleString('en').replaceAll(',', ' ');
const bytes = v => v >= 1e9 ? (v / 1e9).toFixed(2) + ' GB' : Math.round(v / 1e6) + ' MB';
function clock(s) {
    if (s === null) return '–';
    s = Math.round(s);
    return s >= 3600 ? `${Math.floor(s / 3600)} h ${Math.floor(s / 60) % 60} min` : s >= 60 ? `${Math.floor(s / 60)} min ${s % 60} s` : s + ' s';
}

let lost = 0, seen = -1;
async function poll() {
    let state;
    try {
        state = await (await fetch('state')).json();
        lost = 0;
    } catch {
        if (++lost > 2) {
            for (const id of ['pause', 'stop']) $(id).disabled = true;
            return show('splatguard has ended. `splatguard view RUN` shows what it has saved.');
        }
        return setTimeout(poll, 1000);
    }
    const figures = [['iteration', `${count(state.iteration)} of ${count(state.iterations)}`], ['Gaussians', count(state.gaussians) +
        (state.max_gaussians ? ' of at most ' + count(state.max_gaussians) : '')],
        ['loss', state.loss === null ? '–' : state.loss.toFixed(4)], ['PSNR', state.psnr === null ? '–' : state.psnr.toFixed(2) + ' dB'],
        ['memory', bytes(state.memory) + (state.max_memory ? ' of ' + bytes(state.max_memory) : '')],
        ['time left', state.paused ? 'paused' : clock(state.seconds_left)]];
    if (state.defense) figures.push(['removed by the defense', count(state.removed)]);
    $('figures').replaceChildren(...figures.map(([name, value]) => {
        const box = document.createElement('div');
        box.append(Object.assign(document.createElement('dt'), {textContent: name}),
            Object.assign(document.createElement('dd'), {textContent: value}));
        return box;
    }));
    $('progress').value = state.iterations ? state.iteration / state.iterations : 0;
    $('pause').textContent = state.paused ? 'Go on' : 'Pause';
    $('pause').dataset.paused = state.paused ? 1 : '';
    if (state.iteration !== seen && !document.hidden && !busy && kind() !== PHOTO) draw(false);
    seen = state.iteration;
    setTimeout(poll, 1000);
}

async function ask(what) {
    try {
        const answer = await fetch(what, {method: 'POST'});
        if (!answer.ok) throw new Error((await answer.text()).trim());
    } catch (error) {
        show(`splatguard did not take "${what}": ${error.message}`, true);
        if (what === 'stop') $('stop').disabled = false;
    }
}

$('pause').addEventListener('click', () => {
    const paused = $('pause').dataset.paused;
    ask(paused ? 'go' : 'pause');
    $('pause').dataset.paused = paused ? '' : 1;
    $('pause').textContent = paused ? 'Pause' : 'Go on';
});
$('stop').addEventListener('click', () => {
    $('stop').disabled = true;
    ask('stop');
});

// ---- begin ----
async function begin() {
    const answer = await fetch('scene');
    if (answer.status === 503) return setTimeout(start, 500); // it is being loaded
    scene = await answer.json();
    document.title = scene.title + ' – splatguard';
    $('title').textContent = scene.title;
    for (const [name, there] of [['photo', scene.photos], ['scores', scene.scores], ['next', scene.next]])
        for (const e of document.querySelectorAll('.' + name)) e.hidden = e.disabled = !there;
    if (!scene.model) {
        for (const option of $('kind').options) option.disabled = +option.value !== PHOTO;
        $('kind').value = PHOTO;
    }
    scene.views.forEach((v, i) => $('photo').add(new Option(v.name + (v.split === 'test' ? ' (test)' : ''), i)));
    $('photo').addEventListener('change', () => jump(+$('photo').value));
    $('previous').addEventListener('click', () => jump(view - 1));
    $('next').addEventListener('click', () => jump(view + 1));
    for (const id of ['kind', 'by']) $(id).addEventListener('change', () => draw(false));
    $('wipe').addEventListener('input', () => photoView === view && render ? paint() : draw(false));
    findMiddle();
    jump(0);
    let width = canvas.clientWidth;
    new ResizeObserver(() => {
        if (canvas.clientWidth === width) return;
        width = canvas.clientWidth;
        draw(false);
    }).observe(canvas);
    if (scene.browser) openDrawing();
    if (scene.training) {
        $('training').hidden = false;
        poll();
    }
}

function start() {
    begin().catch(error => {
        $('message').textContent = 'No page: ' + error.message;
        $('message').classList.add('bad');
    });
}
start();

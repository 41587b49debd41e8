// SPDX-License-Identifier: Apache-2.0
// The figures of a report: SVG drawn from the data of the page, without anything from elsewhere.
'use strict';
const results = JSON.parse(document.getElementById('results').textContent);
const colours = ['#4878d0', '#ee854a', '#6acc64', '#d65f5f', '#956cb4', '#8c613c', '#dc7ec0', '#797979',
    '#d5bb67', '#82c6e2'];
const width = 900, height = 340, left = 70, bottom = 40, top_ = 16, right = 180;
const unique = list => [...new Set(list)];
const defenses = unique(results.map(r => r.defense));
const colour = name => colours[defenses.indexOf(name) % colours.length];
const sceneOf = r => r.plan + ': ' + r.scene + (r.model === 'default' ? '' : ', ' + r.model);
const scenes = unique(results.map(sceneOf));

function element(parent, name, attributes, text) {
    const e = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const key in attributes) e.setAttribute(key, attributes[key]);
    if (text !== undefined) e.textContent = text;
    parent.appendChild(e);
    return e;
}

function ticks(low, high) {
    const step = Math.pow(10, Math.floor(Math.log10((high - low) / 4 || 1)));
    const unit = [1, 2, 5, 10].map(k => k * step).find(u => (high - low) / u <= 6);
    const list = [];
    for (let v = Math.ceil(low / unit) * unit; v <= high + 1e-9 * unit; v += unit) list.push(v);
    return list;
}

const short = v => Math.abs(v) >= 1e6 ? +(v / 1e6).toPrecision(4) + ' M' : Math.abs(v) >= 1e4 ? +(v / 1e3).toPrecision(4) + ' k'
    : String(+v.toPrecision(4));

// An empty plot with axes, with numbers at that of x or without. px and py convert to its pixels.
function plot(id, title, x, y, numbers) {
    const figure = document.getElementById(id);
    figure.replaceChildren();
    const svg = element(figure, 'svg', {viewBox: `0 0 ${width} ${height}`, role: 'img', 'aria-label': title});
    const span = v => v[1] > v[0] ? v : [v[0] - 1, v[0] + 1];
    x = span(x), y = span(y);
    const px = v => left + (v - x[0]) / (x[1] - x[0]) * (width - left - right);
    const py = v => height - bottom - (v - y[0]) / (y[1] - y[0]) * (height - bottom - top_);
    for (const v of ticks(...y)) {
        element(svg, 'path', {class: 'axis', d: `M${left} ${py(v)}H${width - right}`});
        element(svg, 'text', {x: left - 6, y: py(v) + 4, 'text-anchor': 'end'}, short(v));
    }
    if (numbers)
        for (const v of ticks(...x))
            element(svg, 'text', {x: px(v), y: height - bottom + 18, 'text-anchor': 'middle'}, short(v));
    element(svg, 'path', {class: 'axis', d: `M${left} ${top_}V${height - bottom}H${width - right}`});
    const caption = document.createElement('figcaption');
    caption.textContent = title;
    figure.appendChild(caption);
    return {svg, px, py};
}

function legend(svg, names) {
    names.forEach((name, i) => {
        element(svg, 'rect', {x: width - right + 16, y: top_ + 18 * i, width: 12, height: 12, fill: colour(name)});
        element(svg, 'text', {x: width - right + 34, y: top_ + 18 * i + 11}, name);
    });
}

function mark(svg, name, attributes, value, title) {
    const e = element(svg, name, {...attributes, class: 'mark', 'data-value': value});
    element(e, 'title', {}, title);
    return e;
}

const mean = list => list.reduce((a, b) => a + b, 0) / list.length;

// Bars of the mean over seeds, photos side by side.
function bars(id, title, key, chosen) {
    const photos = unique(chosen.map(r => r.photos)), shown = defenses.filter(d => chosen.some(r => r.defense === d));
    const cells = shown.flatMap(d => photos.map(p => ({d, p,
        v: chosen.filter(r => r.defense === d && r.photos === p && r[key] !== null).map(r => r[key])})));
    const most = Math.max(0, ...cells.filter(c => c.v.length).map(c => mean(c.v)));
    const {svg, py} = plot(id, title, [0, 1], [0, most * 1.05 || 1], false);
    const group = (width - left - right) / photos.length, bar = group / (shown.length + 1);
    photos.forEach((p, i) => {
        element(svg, 'text', {x: left + group * (i + .5), y: height - bottom + 18, 'text-anchor': 'middle'}, p);
        shown.forEach((d, k) => {
            const v = cells.find(c => c.d === d && c.p === p).v;
            if (!v.length) return;
            const m = mean(v), y = py(m);
            mark(svg, 'rect', {x: left + group * i + bar * (k + .5), y, width: bar * .9, height: height - bottom - y,
                fill: colour(d)}, m, `${p}, ${d}: ${short(m)} (n = ${v.length})`);
        });
    });
    legend(svg, shown);
}

// Quality against Gaussians: circles on clean photos, squares on others.
function scatter(id, title, chosen) {
    const points = chosen.filter(r => r.gaussians !== null && r.psnr !== null);
    if (!points.length) return document.getElementById(id).replaceChildren();
    const range = key => [Math.min(...points.map(r => r[key])), Math.max(...points.map(r => r[key]))];
    const y = range('psnr');
    const {svg, px, py} = plot(id, title, [0, range('gaussians')[1] * 1.05], [y[0] - .3, y[1] + .3], true);
    for (const r of points) {
        const text = `${r.photos}, ${r.defense}, seed ${r.seed}: ${short(r.gaussians)} Gaussians, ${r.psnr.toFixed(2)} dB`;
        if (r.photos === 'clean')
            mark(svg, 'circle', {cx: px(r.gaussians), cy: py(r.psnr), r: 6, fill: colour(r.defense)}, r.psnr, text);
        else
            mark(svg, 'rect', {x: px(r.gaussians) - 5, y: py(r.psnr) - 5, width: 10, height: 10,
                fill: colour(r.defense)}, r.psnr, text);
    }
    legend(svg, defenses.filter(d => points.some(r => r.defense === d)));
}

// A column of the curves over the iterations, one line a run.
function lines(id, title, column, chosen) {
    const runs = chosen.filter(r => r.curve.length);
    const points = runs.flatMap(r => r.curve.filter(p => p[column] !== null));
    if (!points.length) return document.getElementById(id).replaceChildren();
    const {svg, px, py} = plot(id, title, [0, Math.max(...points.map(p => p[0]))],
        [0, Math.max(...points.map(p => p[column])) * 1.05], true);
    for (const r of runs) {
        const curve = r.curve.filter(p => p[column] !== null);
        if (!curve.length) continue;
        element(svg, 'path', {d: 'M' + curve.map(p => px(p[0]).toFixed(1) + ' ' + py(p[column]).toFixed(1)).join('L'),
            fill: 'none', stroke: colour(r.defense), 'stroke-width': 2,
            'stroke-dasharray': r.photos === 'clean' ? '5 4' : 'none'});
        const end = curve[curve.length - 1];
        mark(svg, 'circle', {cx: px(end[0]), cy: py(end[column]), r: 5, fill: colour(r.defense)}, end[column],
            `${r.photos}, ${r.defense}, seed ${r.seed}: ${short(end[column])} at the end`);
    }
    legend(svg, defenses.filter(d => runs.some(r => r.defense === d)));
}

function choose(id, names) {
    const list = document.getElementById(id);
    for (const name of names) list.add(new Option(name, name));
    list.addEventListener('change', draw);
}

function draw() {
    const scene = document.getElementById('scene').value, photos = document.getElementById('photos').value,
        defense = document.getElementById('defense').value;
    const of = results.filter(r => sceneOf(r) === scene && (!defense || r.defense === defense || r.defense === 'off'));
    const chosen = of.filter(r => !photos || r.photos === photos);
    bars('gaussians', 'Most Gaussians of a training', 'max_gaussians', chosen);
    bars('quality', 'PSNR on the test views of the clean scene, dB', 'psnr', chosen);
    scatter('tradeoff', 'PSNR against Gaussians: circles on clean photos, squares on others', chosen);
    lines('growth', 'Gaussians over the iterations; dashed on clean photos', 1, chosen);
    lines('instances', '(Gaussian, tile) pairs of the view over the iterations: what memory and time follow', 3, chosen);
}

choose('scene', scenes);
choose('photos', unique(results.map(r => r.photos)));
choose('defense', defenses);
draw();

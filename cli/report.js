// SPDX-License-Identifier: Apache-2.0
// The figures of a report: SVG drawn from the data of the page, without anything from elsewhere.
'use strict';
const results = JSON.parse(document.getElementById('results').textContent);
const photoList = JSON.parse(document.getElementById('photo-list').textContent); // each once, by its number
for (const r of results)
    if (r.pictures && r.pictures.photo !== undefined) r.pictures.photo = photoList[r.pictures.photo];
const audits = JSON.parse(document.getElementById('audits').textContent);
// On light and on dark paper with a contrast of 3 at least.
const colours = ['#4678d2', '#f06414', '#28960a', '#b4328c', '#8c5a0a', '#8c968c', '#c86ee6', '#00786e', '#826482', '#c83232',
    '#e65a8c', '#a09600', '#8c50c8', '#00a0c8', '#b46e5a', '#9682be', '#00a082', '#6e8246', '#8c78fa', '#00781e'];
// A figure is as wide as its place, so that its letters are as large as the text's. Where that is narrow its legend is below.
const height = 340, left = 62, top_ = 16, narrow = 640;
let width = 900, bottom = 40, right = 180;
const rows = Math.floor((height - top_) / 20); // of a legend beside a figure
const unique = list => [...new Set(list)];
const defenses = unique(results.map(r => r.defense));
const photosName = 'the photos';
let shownDefenses = []; // each has a colour of its own while there are enough
const colour = name => name === photosName ? 'currentColor' : colours[shownDefenses.indexOf(name) % colours.length];
const sceneOf = r => JSON.stringify([r.plan, r.scene, r.model]); // names may have any letters
const scenes = unique(results.map(sceneOf));
const titleOfScene = key => {
    const [plan, scene, model] = JSON.parse(key);
    return plan + ': ' + scene + (model === 'default' ? '' : ', ' + model);
};
const kinds = unique(audits.map(a => a.photos));
const colourOfKind = name => colours[kinds.indexOf(name) % colours.length];

function element(parent, name, attributes, text) {
    const e = document.createElementNS('http://www.w3.org/2000/svg', name);
    for (const key in attributes) e.setAttribute(key, attributes[key]);
    if (text !== undefined) e.textContent = text;
    parent.appendChild(e);
    return e;
}

// At most eight, also where numbers are so large that adding a unit does not change them.
function ticks(low, high) {
    const step = Math.pow(10, Math.floor(Math.log10((high - low) / 4 || 1)));
    const unit = [1, 2, 5, 10].map(k => k * step).find(u => (high - low) / u <= 6);
    const first = Math.ceil(low / unit);
    return [0, 1, 2, 3, 4, 5, 6, 7].map(k => (first + k) * unit).filter(v => v <= high + 1e-9 * unit);
}

const short = v => Math.abs(v) >= 1e6 ? +(v / 1e6).toPrecision(4) + ' M' : Math.abs(v) >= 1e4 ? +(v / 1e3).toPrecision(4) + ' k'
    : String(+v.toPrecision(4));

// An empty plot with axes, with numbers at that of x or without. px and py convert to its pixels.
function plot(id, title, x, y, numbers) {
    const figure = document.getElementById(id);
    figure.replaceChildren();
    width = Math.max(300, Math.min(900, figure.clientWidth || 900));
    right = width < narrow ? 24 : 180, bottom = width < narrow && !numbers ? 90 : 40;
    const svg = element(figure, 'svg', {viewBox: `0 0 ${width} ${height}`, width, role: 'img', 'aria-label': title});
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

// Beside the figure, or below it where there is no room.
function legend(svg, names, paint = colour) {
    const entries = names.map(name => {
        const entry = element(svg, 'g', {});
        element(entry, 'rect', {width: 12, height: 12, style: `fill: ${paint(name)}`});
        element(entry, 'text', {x: 18, y: 11}, name);
        return entry;
    });
    const longest = most(entries.map(e => e.lastChild.getComputedTextLength()), 0), step = Math.max(190, longest + 36),
        below = width < narrow || names.length > rows || longest > right - 34,
        x = below ? Math.max(0, Math.min(left, width - longest - 18)) : width - right + 16, y = below ? height + 4 : top_,
        columns = below ? Math.max(1, Math.floor((width - x) / step)) : 1;
    entries.forEach((e, i) =>
        e.setAttribute('transform', `translate(${x + step * (i % columns)} ${y + 20 * Math.floor(i / columns)})`));
    if (below) svg.setAttribute('viewBox', `0 0 ${width} ${y + 20 * Math.ceil(names.length / columns)}`);
}

function mark(svg, name, attributes, value, title) {
    const e = element(svg, name, {...attributes, class: 'mark', 'data-value': value});
    element(e, 'title', {}, title);
    return e;
}

const mean = list => list.reduce((a, b) => a + b, 0) / list.length;
// Of lists that can be longer than a call may have arguments.
const least = (list, first) => list.reduce((a, b) => Math.min(a, b), first);
const most = (list, first) => list.reduce((a, b) => Math.max(a, b), first);

// The mean over seeds of each defense, photos side by side, with a line from the least to the most. Counts are bars from 0;
// dB, whose differences count and not their ratios, are points. published: what the paper has of a run, or nothing; an
// outlined diamond, which `note` explains.
function means(id, title, key, chosen, published, note, asBars) {
    const photos = unique(chosen.map(r => r.photos)), shown = defenses.filter(d => chosen.some(r => r.defense === d));
    const cells = shown.flatMap(d => photos.map(p => ({d, p,
        v: chosen.filter(r => r.defense === d && r.photos === p && r[key] !== null).map(r => r[key]),
        paper: chosen.filter(r => r.defense === d && r.photos === p && r.paper).map(published).find(v => v > 0)})));
    const all = cells.flatMap(c => c.paper ? [...c.v, c.paper] : c.v);
    if (!all.length) return document.getElementById(id).replaceChildren();
    const low = least(all, Infinity), high = most(all, -Infinity), edge = .05 * (high - low) || 1;
    const caption = title + (cells.some(c => c.paper) ? `; diamonds: the paper's, ${note}` : '');
    const {svg, py} = plot(id, caption, [0, 1], asBars ? [0, high * 1.05 || 1] : [low - edge, high + edge], false);
    const group = (width - left - right) / photos.length, bar = group / (shown.length + 1);
    photos.forEach((p, i) => {
        const x = left + group * (i + .5), y = height - bottom + 18;
        element(svg, 'text', width < narrow ? {x, y, 'text-anchor': 'end', transform: `rotate(-35 ${x} ${y})`}
            : {x, y, 'text-anchor': 'middle'}, p);
        shown.forEach((d, k) => {
            const {v, paper} = cells.find(c => c.d === d && c.p === p), middle = left + group * i + bar * (k + .95);
            if (v.length) {
                const m = mean(v), y = py(m), style = `fill: ${colour(d)}`, text = `${p}, ${d}: ${short(m)} (n = ${v.length})`;
                if (asBars)
                    mark(svg, 'rect', {x: left + group * i + bar * (k + .5), y, width: bar * .9, height: height - bottom - y, style}, m, text);
                else
                    mark(svg, 'circle', {cx: middle, cy: y, r: 5, style}, m, text);
                if (v.length > 1)
                    element(svg, 'path', {class: 'spread', d: `M${middle} ${py(Math.min(...v))}V${py(Math.max(...v))}`});
            }
            if (paper) {
                const e = element(svg, 'path', {class: 'paper', d: `M${middle} ${py(paper) - 6}l6 6l-6 6l-6 -6z`});
                element(e, 'title', {}, `${p}, ${d}: ${short(paper)} in the paper`);
            }
        });
    });
    legend(svg, shown);
}

// Quality against Gaussians: circles on clean photos, squares on others.
function scatter(id, title, chosen) {
    const points = chosen.filter(r => r.gaussians !== null && r.psnr !== null);
    if (!points.length) return document.getElementById(id).replaceChildren();
    const range = key => [least(points.map(r => r[key]), Infinity), most(points.map(r => r[key]), -Infinity)];
    const y = range('psnr');
    const {svg, px, py} = plot(id, title, [0, range('gaussians')[1] * 1.05], [y[0] - .3, y[1] + .3], true);
    for (const r of points) {
        const text = `${r.photos}, ${r.defense}, seed ${r.seed}: ${short(r.gaussians)} Gaussians, ${r.psnr.toFixed(2)} dB`;
        if (r.photos === 'clean')
            mark(svg, 'circle', {cx: px(r.gaussians), cy: py(r.psnr), r: 6, style: `fill: ${colour(r.defense)}`}, r.psnr, text);
        else
            mark(svg, 'rect', {x: px(r.gaussians) - 5, y: py(r.psnr) - 5, width: 10, height: 10,
                style: `fill: ${colour(r.defense)}`}, r.psnr, text);
    }
    legend(svg, defenses.filter(d => points.some(r => r.defense === d)));
}

// Lines of points [x, y], each with the colour of a defense: {name, defense, dashed, points}. The mark is at the first
// x from `at` on, or at the end.
function series(id, title, list, low, at) {
    list = list.filter(l => l.points.length);
    const points = list.flatMap(l => l.points);
    if (!points.length) return document.getElementById(id).replaceChildren();
    const ys = points.map(p => p[1]), x = points.map(p => p[0]);
    const lowest = least(ys, low), highest = most(ys, -Infinity); // logarithms can all be below 0
    const {svg, px, py} = plot(id, title, [least(x, 0), most(x, -Infinity)], [lowest, highest + .05 * (highest - lowest)], true);
    for (const l of list) {
        element(svg, 'path', {d: 'M' + l.points.map(p => px(p[0]).toFixed(1) + ' ' + py(p[1]).toFixed(1)).join('L'),
            fill: 'none', stroke: colour(l.defense), 'stroke-width': 2, 'stroke-dasharray': l.dashed ? '5 4' : 'none'});
        const p = l.points.find(q => q[0] >= at) || l.points[l.points.length - 1];
        mark(svg, 'circle', {cx: px(p[0]), cy: py(p[1]), r: 5, style: `fill: ${colour(l.defense)}`}, p[1],
            `${l.name}: ${short(p[1])}` + (at === Infinity ? ' at the end' : ` at ${short(p[0])}`));
    }
    legend(svg, [...defenses, photosName].filter(d => list.some(l => l.defense === d)));
}

// A column of the curves over the iterations, one line a run.
function lines(id, title, column, chosen, scale = 1) {
    series(id, title, chosen.map(r => ({name: `${r.photos}, ${r.defense}, seed ${r.seed}`, defense: r.defense,
        dashed: r.photos === 'clean', points: r.curve.filter(p => p[column] !== null).map(p => [p[0], p[column] * scale])})), 0, Infinity);
}

// Runs with pictures, those without a defense first: their photos are those of all.
const pictured = chosen => chosen.filter(r => r.pictures && r.pictures.render)
    .sort((a, b) => (a.defense !== 'off') - (b.defense !== 'off'));

// A spectrum of the photos of each kind, and of the renders of each run.
function spectra(id, title, kind, chosen, point, low, at) {
    const list = [];
    for (const r of pictured(chosen)) {
        const of = (what, defense) => ({name: `${r.photos}, ${defense}`, photos: r.photos, defense, dashed: r.photos === 'clean',
            points: (r.pictures[what][kind] || []).map(point).filter(p => isFinite(p[1]))});
        if (r.pictures.photo && !list.some(l => l.defense === photosName && l.photos === r.photos))
            list.push(of('photo', photosName));
        list.push(of('render', r.defense));
    }
    series(id, title, list, low, at);
}

const percent = v => (100 * v).toFixed(0) + ' %';

// The ROC curve of the audit for each kind of photos, with the band of its samples and marks at its verdicts.
function rocs(id, title, list) {
    if (!list.length) return document.getElementById(id).replaceChildren();
    const {svg, px, py} = plot(id, title, [0, 1], [0, 1], true);
    const path = points => points.map(p => px(p[0]).toFixed(1) + ' ' + py(p[1]).toFixed(1)).join('L');
    for (const a of list) {
        const at = i => i / (a.band.length - 1);
        element(svg, 'path', {d: 'M' + path([...a.band.map((b, i) => [at(i), b[0]]), ...a.band.map((b, i) => [at(i), b[1]]).reverse()]) + 'Z',
            fill: colourOfKind(a.photos), 'fill-opacity': .2});
    }
    element(svg, 'path', {class: 'axis', d: 'M' + path([[0, 0], [1, 1]])});
    for (const a of list) {
        element(svg, 'path', {d: 'M' + path(a.points), fill: 'none', stroke: colourOfKind(a.photos), 'stroke-width': 2});
        a.marks.forEach((m, i) => mark(svg, 'circle', {cx: px(m[0]), cy: py(m[1]), r: 5, style: `fill: ${colourOfKind(a.photos)}`}, m[1],
            `${a.photos}: ${percent(m[1])} of ${a.n} called poisoned${i ? ' or suspicious' : ''}, ${percent(m[0])} of ${a.clean} clean ones; `
            + `AUC ${a.area.toFixed(3)} (${a.interval.map(v => v.toFixed(3)).join(' to ')})`));
    }
    legend(svg, list.map(a => a.photos), colourOfKind);
}

// The middle of one training view: the photos, and what each run made of them.
function crops(chosen) {
    const section = document.getElementById('crops');
    section.replaceChildren();
    const add = (picture, text) => {
        const figure = document.createElement('figure'), image = document.createElement('img'),
            caption = document.createElement('figcaption');
        image.src = 'data:image/png;base64,' + picture.png;
        image.alt = caption.textContent = text;
        figure.append(image, caption);
        section.append(figure);
    };
    const seen = new Set();
    for (const r of pictured(chosen)) {
        if (r.pictures.photo && r.pictures.photo.png && !seen.has(r.photos)) {
            seen.add(r.photos);
            add(r.pictures.photo, `${r.photos}: photo ${r.pictures.photo.view}`);
        }
        if (r.pictures.render.png)
            add(r.pictures.render, `${r.photos}, ${r.defense}` + (r.psnr === null ? '' : `: ${r.psnr.toFixed(2)} dB`));
    }
}

function choose(id, names, titleOf = name => name) {
    const list = document.getElementById(id);
    for (const name of names) list.add(new Option(titleOf(name), name));
    list.addEventListener('change', draw);
}

const defensesOf = scene => unique(results.filter(r => sceneOf(r) === scene).map(r => r.defense));

// A box for each defense, beside its colour; at first as many of a scene are ticked as there are colours.
function chooseDefenses() {
    const place = document.getElementById('defenses'), first = scenes.flatMap(s => defensesOf(s).slice(0, colours.length));
    for (const name of defenses) {
        const label = document.createElement('label'), box = document.createElement('input'), swatch = document.createElement('span');
        box.type = 'checkbox', box.value = name, box.checked = first.includes(name);
        swatch.className = 'swatch';
        label.append(box, swatch, name);
        place.append(label);
    }
    for (const [name, ticked] of [['all', true], ['none', false]]) {
        const button = document.createElement('button');
        button.type = 'button', button.textContent = name;
        button.addEventListener('click', () => {
            for (const box of place.querySelectorAll('label:not([hidden]) input')) box.checked = ticked;
            draw();
        });
        place.append(button);
    }
    place.addEventListener('change', draw);
}

// Those of the scene that are ticked.
function updateDefenses(scene) {
    const there = defensesOf(scene), labels = [...document.querySelectorAll('#defenses label')];
    for (const label of labels) label.hidden = !there.includes(label.firstChild.value);
    shownDefenses = labels.filter(l => !l.hidden && l.firstChild.checked).map(l => l.firstChild.value);
    for (const {firstChild: box, childNodes: [, swatch]} of labels)
        swatch.style.background = box.checked ? colour(box.value) : 'none';
}

function draw() {
    const scene = document.getElementById('scene').value, photos = document.getElementById('photos').value;
    updateDefenses(scene);
    const of = results.filter(r => sceneOf(r) === scene);
    const chosen = of.filter(r => (!photos || r.photos === photos) && shownDefenses.includes(r.defense));
    const clean = of.filter(r => r.photos === 'clean' && r.defense === 'off' && r.max_gaussians).map(r => r.max_gaussians);
    means('gaussians', 'Most Gaussians of a training', 'max_gaussians', chosen, r => r.paper.growth * mean(clean),
        'its ratio times the clean run here', true);
    means('quality', 'PSNR on the test views of the clean scene, dB', 'psnr', chosen, r => r.paper.psnr, 'at full size', false);
    scatter('tradeoff', 'PSNR against Gaussians: circles on clean photos, squares on others', chosen);
    lines('growth', 'Gaussians over the iterations; dashed on clean photos', 1, chosen);
    lines('instances', '(Gaussian, tile) pairs of the view over the iterations: what memory and time follow', 3, chosen);
    lines('memory', 'Memory of the library over the iterations, MB; dashed on clean photos', 4, chosen, 1e-6);
    spectra('radial', 'Energy over frequency in cycles per pixel, log10 of the mean over training views; dashed on clean photos',
        'radial', chosen, (v, i) => [(i + .5) / 128, Math.log10(v)], -2, .375);
    spectra('angular', 'Share of the energy between 0.15 and 0.45 cycles per pixel by direction in degrees',
        'angular', chosen, (v, i) => [-180 + 10 * (i + .5), v], 0, 0);
    rocs('roc', 'The audit: share of photos over share of clean photos with at least the same score (ROC), with a band of 95 %; '
        + 'marks: called poisoned, and poisoned or suspicious',
        audits.filter(a => of.some(r => r.plan === a.plan && r.scene === a.scene) && (!photos || a.photos === photos)));
    crops(chosen);
}

choose('scene', scenes, titleOfScene);
choose('photos', unique(results.map(r => r.photos)));
chooseDefenses();
let shownWidth = document.body.clientWidth;
addEventListener('resize', () => {
    if (document.body.clientWidth === shownWidth) return;
    shownWidth = document.body.clientWidth;
    draw();
});
draw();

/* SPDX-License-Identifier: Apache-2.0 */
/* Materials of the solids: procedural textures, gloss and print. */
#ifndef SG_SYNTH_MATERIALS_H
#define SG_SYNTH_MATERIALS_H

#include "vec.h"

enum material {
    MATERIAL_FLOOR, /* chequered marble in a ring of wood */
    MATERIAL_MARBLE,
    MATERIAL_PLANKS, /* a crate of boards */
    MATERIAL_TIMBER, /* rungs, pickets */
    MATERIAL_PAINT,  /* white lacquered wood */
    MATERIAL_BRASS,
    MATERIAL_STEEL,
    MATERIAL_CHROME,  /* a mirror */
    MATERIAL_LACQUER, /* red, clear coat */
    MATERIAL_CERAMIC, /* blue-green glaze */
    MATERIAL_MATTE,   /* soft colour gradient, no gloss */
    MATERIAL_TERRACOTTA,
    MATERIAL_RUBBER,
    MATERIAL_PLAQUE, /* the name, engraved */
    MATERIAL_CHART,  /* ever smaller print */
};

struct surface {
    struct vec albedo;
    struct vec specular; /* reflectance at normal incidence */
    double shininess;    /* Blinn's exponent */
    double mirror;       /* part of the reflection that is sharp, 0..1: traced if above 0 */
};

/* p and n are in the frame of the object, so that a texture moves with it. */
struct surface sg_synth_surface(enum material material, struct vec p, struct vec n);

/* Half sides of the printed faces, which look along -y of their object. */
#define PLAQUE_WIDE 0.54
#define PLAQUE_HIGH 0.155
#define CHART_WIDE 0.34
#define CHART_HIGH 0.27

#endif

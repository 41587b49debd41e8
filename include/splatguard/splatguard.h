/* SPDX-License-Identifier: Apache-2.0 */
/* All of the library. Functions that end an object take a pointer to the caller's pointer
 * (sg_..._destroy, sg_run_close, sg_output_release): they accept NULL and a pointer to NULL, and
 * set the caller's pointer to NULL. Functions sg_..._clear free what a struct owns, which may be
 * zeroed; the struct is the caller's. */
#ifndef SPLATGUARD_SPLATGUARD_H
#define SPLATGUARD_SPLATGUARD_H

#include "attack.h"
#include "audit.h"
#include "camera.h"
#include "context.h"
#include "defense.h"
#include "engine.h"
#include "error.h"
#include "eval.h"
#include "format.h"
#include "model.h"
#include "option.h"
#include "output.h"
#include "path.h"
#include "picture.h"
#include "prune.h"
#include "render.h"
#include "run.h"
#include "scene.h"
#include "spectrum.h"
#include "synth.h"
#include "train.h"
#include "version.h"
#include "variation.h"

#endif

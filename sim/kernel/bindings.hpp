// One function a source file: adds that file's functions to the module.
#pragma once
#include <nanobind/nanobind.h>

void bind_closed_form(nanobind::module_ &m);
void bind_rectangles(nanobind::module_ &m);
void bind_paper(nanobind::module_ &m);
void bind_polygon(nanobind::module_ &m);
void bind_occlusion(nanobind::module_ &m);
void bind_compressed(nanobind::module_ &m);
void bind_sampling(nanobind::module_ &m);
void bind_sixteenths(nanobind::module_ &m);
void bind_exchange(nanobind::module_ &m);
void bind_sparse(nanobind::module_ &m);
void bind_solve(nanobind::module_ &m);
void bind_image(nanobind::module_ &m);
void bind_frame(nanobind::module_ &m);

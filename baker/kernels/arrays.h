// Arrays from and to Python. nanobind checks shape and dtype of inputs; outputs are allocated here.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <initializer_list>
#include <stdexcept>

namespace nb = nanobind;

template <class Real, nb::ssize_t... Shape>
using Input = nb::ndarray<const Real, nb::shape<Shape...>, nb::c_contig, nb::device::cpu>;
template <class Real> using Output = nb::ndarray<nb::numpy, Real, nb::c_contig>;

inline void require(bool condition, const char* message)
{
    if (!condition)
        throw std::invalid_argument(message); // ValueError in Python
}

template <class Real> Output<Real> allocate(std::initializer_list<size_t> shape)
{
    size_t size = 1;
    for (size_t extent : shape)
        size *= extent;
    Real* data = new Real[size];
    return Output<Real>(
        data, shape, nb::capsule(data, [](void* p) noexcept { delete[] static_cast<Real*>(p); }));
}

// Package exr writes developed images as OpenEXR files, with the C++ OpenEXR library behind a
// small cgo shim (see doc/decisions/0001-exr-writer.md).
package exr

/*
#cgo pkg-config: OpenEXR
#cgo CXXFLAGS: -std=c++17 -O2 -Wall -Wextra
#include <stdlib.h>
#include "shim.h"
*/
import "C"

import (
	"errors"
	"fmt"
	"io"
	"math"
	"runtime"
	"strconv"
	"unsafe"

	"metrofarm/services/internal/job"
)

// MaxSide is the largest width or height, in pixels.
const MaxSide = 32768

// Options choose how pixels are stored.
type Options struct {
	// Half stores R, G and B as 16-bit floats: half the size, 11 bits of precision. Values beyond
	// the range become the largest finite one. Otherwise 32-bit floats.
	Half bool
	// Variance adds the layer variance.R, variance.G, variance.B, always as 32-bit floats (its
	// values are often below what 16 bits can tell from zero).
	Variance bool
}

// Write writes image to w: scanlines, ZIP, linear RGB with Rec. 709 chromaticities, the image's
// layers as 32-bit floats, and how the image came about as attributes. It holds the whole file in memory until it is complete.
func Write(w io.Writer, image job.Image, options Options) error {
	if err := check(image, options); err != nil {
		return fmt.Errorf("writing EXR: %w", err)
	}
	var writer *C.mf_exr_writer
	if err := toError(C.mf_exr_writer_new(C.int(image.Width), C.int(image.Height), &writer)); err != nil {
		return fmt.Errorf("writing EXR: %w", err)
	}
	defer C.mf_exr_writer_free(writer)
	if err := setAttributes(writer, image); err != nil {
		return fmt.Errorf("writing EXR: %w", err)
	}
	if err := encode(w, writer, image, options); err != nil {
		return fmt.Errorf("writing EXR: %w", err)
	}
	return nil
}

func check(image job.Image, options Options) error {
	if image.Width < 1 || image.Height < 1 || image.Width > MaxSide || image.Height > MaxSide {
		return fmt.Errorf("size %d x %d: each must be 1 to %d", image.Width, image.Height, MaxSide)
	}
	want := 3 * image.Width * image.Height
	if len(image.RGB) != want {
		return fmt.Errorf("%d RGB values for %d x %d pixels, want %d",
			len(image.RGB), image.Width, image.Height, want)
	}
	if options.Variance && len(image.Variance) != want {
		return fmt.Errorf("%d variances for %d x %d pixels, want %d",
			len(image.Variance), image.Width, image.Height, want)
	}
	for _, layer := range image.Layers {
		if len(layer.Values) != want {
			return fmt.Errorf("layer %s: %d values for %d x %d pixels, want %d",
				layer.Name, len(layer.Values), image.Width, image.Height, want)
		}
	}
	return nil
}

func encode(w io.Writer, writer *C.mf_exr_writer, image job.Image, options Options) error {
	layers := image.Layers
	if options.Variance {
		layers = append(layers[:len(layers):len(layers)], job.ImageLayer{
			Name: "variance", Channels: [3]string{"R", "G", "B"}, Values: image.Variance,
		})
	}
	// The writer keeps pointers to the values until the file is encoded.
	var pinner runtime.Pinner
	defer pinner.Unpin()
	for _, layer := range layers {
		pinner.Pin(&layer.Values[0])
		if err := addLayer(writer, layer); err != nil {
			return err
		}
	}
	half := C.int(0)
	if options.Half {
		half = 1
	}
	var bytes *C.char
	var size C.size_t
	message := C.mf_exr_encode(writer, (*C.float)(&image.RGB[0]), half, &bytes, &size)
	if err := toError(message); err != nil {
		return err
	}
	_, err := w.Write(unsafe.Slice((*byte)(unsafe.Pointer(bytes)), int(size)))
	return err
}

// addLayer requires: the values are pinned.
func addLayer(writer *C.mf_exr_writer, layer job.ImageLayer) error {
	for c, channel := range layer.Channels {
		name := C.CString(layer.Name + "." + channel)
		err := toError(C.mf_exr_add_channel(writer, name, (*C.float)(&layer.Values[c])))
		C.free(unsafe.Pointer(name))
		if err != nil {
			return fmt.Errorf("layer %s: %w", layer.Name, err)
		}
	}
	return nil
}

// setAttributes records how the image came about. Counts that may pass 2^31 and the seed are
// strings: EXR has no 64-bit integers.
func setAttributes(writer *C.mf_exr_writer, image job.Image) error {
	texts := []struct{ name, value string }{
		{"software", "Metrofarm"},
		{"sceneDigest", image.SceneDigest},
		{"filmSHA256", image.FilmSHA256},
		{"integrator", image.Integrator},
		{"jobId", image.JobID},
		{"seed", strconv.FormatUint(image.Seed, 10)},
		{"mutations", strconv.FormatUint(image.Mutations, 10)},
	}
	for _, text := range texts {
		if err := setString(writer, text.name, text.value); err != nil {
			return fmt.Errorf("attribute %s: %w", text.name, err)
		}
	}
	if err := setInt(writer, "rounds", image.Rounds); err != nil {
		return fmt.Errorf("attribute rounds: %w", err)
	}
	numbers := []struct {
		name  string
		value float64
	}{{"b", image.B}, {"bStandardError", image.BStandardError}, {"relMSE", image.RelMSE}}
	for _, number := range numbers {
		if err := setFloat(writer, number.name, number.value); err != nil {
			return fmt.Errorf("attribute %s: %w", number.name, err)
		}
	}
	return nil
}

func setString(writer *C.mf_exr_writer, name, value string) error {
	cName, cValue := C.CString(name), C.CString(value)
	defer C.free(unsafe.Pointer(cName))
	defer C.free(unsafe.Pointer(cValue))
	return toError(C.mf_exr_set_string(writer, cName, cValue))
}

func setInt(writer *C.mf_exr_writer, name string, value int) error {
	if value < math.MinInt32 || value > math.MaxInt32 {
		return fmt.Errorf("%d does not fit into 32 bits", value)
	}
	cName := C.CString(name)
	defer C.free(unsafe.Pointer(cName))
	return toError(C.mf_exr_set_int(writer, cName, C.int(value)))
}

func setFloat(writer *C.mf_exr_writer, name string, value float64) error {
	cName := C.CString(name)
	defer C.free(unsafe.Pointer(cName))
	return toError(C.mf_exr_set_float(writer, cName, C.float(value)))
}

// toError takes over a message of the shim.
func toError(message *C.char) error {
	if message == nil {
		return nil
	}
	defer C.free(unsafe.Pointer(message))
	return errors.New(C.GoString(message))
}

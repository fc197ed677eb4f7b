package exr

/*
#include <stdlib.h>
#include "shim.h"
*/
import "C"

import (
	"errors"
	"fmt"
	"io"
	"unsafe"
)

// File is what Read finds in an EXR file.
type File struct {
	Width, Height int
	// Channels by name, one value per pixel, row by row from the top.
	Channels map[string][]float32
	// Half tells which channels are stored as 16-bit floats.
	Half map[string]bool
	// Attributes of the types string, int and float, as text.
	Attributes map[string]string
}

// Read reads a scanline or tiled single-part file. It is meant for files of trusted origin: the
// memory it takes is what the header asks for, up to MaxSide pixels a side.
func Read(r io.Reader) (File, error) {
	data, err := io.ReadAll(r)
	if err != nil {
		return File{}, fmt.Errorf("reading EXR: %w", err)
	}
	file, err := decode(data)
	if err != nil {
		return File{}, fmt.Errorf("reading EXR: %w", err)
	}
	return file, nil
}

func decode(data []byte) (File, error) {
	if len(data) == 0 {
		return File{}, errors.New("the file is empty")
	}
	bytes := C.CBytes(data)
	defer C.free(bytes)
	var reader *C.mf_exr_reader
	if err := toError(C.mf_exr_reader_new((*C.char)(bytes), C.size_t(len(data)), &reader)); err != nil {
		return File{}, err
	}
	defer C.mf_exr_reader_free(reader)
	var width, height C.int
	C.mf_exr_size(reader, &width, &height)
	if width < 1 || height < 1 || width > MaxSide || height > MaxSide {
		return File{}, fmt.Errorf("size %d x %d: each must be 1 to %d", width, height, MaxSide)
	}
	file := File{Width: int(width), Height: int(height), Attributes: readAttributes(reader)}
	if err := readChannels(reader, &file); err != nil {
		return File{}, err
	}
	return file, nil
}

func readAttributes(reader *C.mf_exr_reader) map[string]string {
	attributes := make(map[string]string)
	for i := range C.mf_exr_attribute_count(reader) {
		var value *C.char
		name := C.mf_exr_attribute(reader, i, &value)
		attributes[C.GoString(name)] = C.GoString(value)
	}
	return attributes
}

func readChannels(reader *C.mf_exr_reader, file *File) error {
	file.Channels = make(map[string][]float32)
	file.Half = make(map[string]bool)
	for i := range C.mf_exr_channel_count(reader) {
		var half C.int
		cName := C.mf_exr_channel(reader, i, &half)
		name := C.GoString(cName)
		values := make([]float32, file.Width*file.Height)
		pointer := (*C.float)(unsafe.Pointer(&values[0]))
		if err := toError(C.mf_exr_read_channel(reader, cName, pointer)); err != nil {
			return fmt.Errorf("channel %s: %w", name, err)
		}
		file.Channels[name] = values
		file.Half[name] = half == 1
	}
	return nil
}

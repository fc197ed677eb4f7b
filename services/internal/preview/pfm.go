package preview

import (
	"bufio"
	"encoding/binary"
	"errors"
	"fmt"
	"io"
	"math"

	"metrofarm/services/internal/job"
)

// checkPixels makes sure that an image has what its size says.
func checkPixels(image job.Image) error {
	if image.Width < 1 || image.Height < 1 {
		return errors.New("the image has no pixels")
	}
	if want := 3 * image.Width * image.Height; len(image.RGB) != want {
		return fmt.Errorf("%d values, want %d", len(image.RGB), want)
	}
	return nil
}

// WritePFM writes the image's values as a portable float map of three channels, little-endian, with
// the lowest row first.
func WritePFM(w io.Writer, image job.Image) error {
	if err := checkPixels(image); err != nil {
		return fmt.Errorf("writing PFM: %w", err)
	}
	buffered := bufio.NewWriterSize(w, 1<<16)
	fmt.Fprintf(buffered, "PF\n%d %d\n-1.0\n", image.Width, image.Height)
	row := make([]byte, 0, 12*image.Width)
	for y := image.Height - 1; y >= 0; y-- {
		row = row[:0]
		for _, value := range image.RGB[3*image.Width*y : 3*image.Width*(y+1)] {
			row = binary.LittleEndian.AppendUint32(row, math.Float32bits(value))
		}
		_, _ = buffered.Write(row) // Flush returns the first error
	}
	if err := buffered.Flush(); err != nil {
		return fmt.Errorf("writing PFM: %w", err)
	}
	return nil
}

// Shrink returns the image with its longer side at most size pixels long: each pixel is the mean of a
// rectangle of whole ones. An image that is small enough is returned as it is.
func Shrink(image job.Image, size int) job.Image {
	longer := max(image.Width, image.Height)
	if longer <= size || checkPixels(image) != nil {
		return image
	}
	width, height := max(1, image.Width*size/longer), max(1, image.Height*size/longer)
	small := job.Image{Width: width, Height: height, RGB: make([]float32, 3*width*height)}
	for y := range height {
		top, bottom := y*image.Height/height, (y+1)*image.Height/height
		for x := range width {
			left, right := x*image.Width/width, (x+1)*image.Width/width
			mean := meanOf(image, left, right, top, bottom)
			copy(small.RGB[3*(y*width+x):], mean[:])
		}
	}
	return small
}

// meanOf a rectangle of pixels.
func meanOf(image job.Image, left, right, top, bottom int) (mean [3]float32) {
	var sums [3]float64
	for y := top; y < bottom; y++ {
		row := image.RGB[3*(y*image.Width+left) : 3*(y*image.Width+right)]
		for i, value := range row {
			sums[i%3] += float64(value)
		}
	}
	pixels := float64((right - left) * (bottom - top))
	for c, sum := range sums {
		mean[c] = float32(sum / pixels)
	}
	return mean
}

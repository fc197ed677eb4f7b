// Package film holds the exact sums of a job's splats: signed 128-bit fixed point per value, tiles
// that exist only where something arrived, and the canonical order in which they are hashed.
// DESIGN.md beside this file has the layout and the reasons. The package is pure; a Film is not
// safe for concurrent use, its snapshots are.
package film

import "fmt"

// Sizes that the wire format fixes.
const (
	Channels   = 3
	TileSize   = 32 // pixels on a side of a full-resolution tile
	LowSize    = 16 // cells on a side of a low-resolution plane
	Halves     = 2
	StatGroups = 16

	FullTileValues = TileSize * TileSize * Channels
	LowTileValues  = LowSize * LowSize * Channels

	// MaxSide is the largest film width and height.
	MaxSide = 32768

	maxLayers = 14
)

// Shape is what fixes the number and meaning of a film's values.
type Shape struct {
	Width, Height int
	// Layers: 2 for chains (chain weights, large steps), 3 with direct light apart, 1 for independent
	// samples; then, of chains, 1 for the acceptance map and 10 for images by technique.
	Layers int
}

// Validate refuses shapes that no film can have.
func (s Shape) Validate() error {
	if s.Width < 1 || s.Height < 1 || s.Width > MaxSide || s.Height > MaxSide {
		return fmt.Errorf("film: size %d x %d is outside 1..%d", s.Width, s.Height, MaxSide)
	}
	if s.Layers < 1 || s.Layers > maxLayers {
		return fmt.Errorf("film: %d layers, not 1 to %d", s.Layers, maxLayers)
	}
	return nil
}

// TilesX is the number of tile columns.
func (s Shape) TilesX() int { return (s.Width + TileSize - 1) / TileSize }

// TilesY is the number of tile rows.
func (s Shape) TilesY() int { return (s.Height + TileSize - 1) / TileSize }

// FullPlanes is the number of full-resolution planes; plane h*Layers + l is half h, layer l.
func (s Shape) FullPlanes() int { return Halves * s.Layers }

// LowPlanes is the number of low-resolution planes; plane g*Layers + l is statistics group g.
func (s Shape) LowPlanes() int { return StatGroups * s.Layers }

// CellWidth is the width of a low-resolution cell in pixels.
func (s Shape) CellWidth() int { return (s.Width + LowSize - 1) / LowSize }

// CellHeight is the height of a low-resolution cell in pixels.
func (s Shape) CellHeight() int { return (s.Height + LowSize - 1) / LowSize }

// TileCount is the number of tiles that a film can have, low-resolution ones included.
func (s Shape) TileCount() int {
	return s.FullPlanes()*s.TilesX()*s.TilesY() + s.LowPlanes()
}

// Address names one tile.
type Address struct {
	Low   bool
	Plane int
	X, Y  int // in tiles; 0 for a low-resolution plane
}

// Index is the tile's place in canonical order: full planes first, each row by row, then the low
// planes. It fails for an address outside the film.
func (s Shape) Index(a Address) (int, error) {
	full := s.FullPlanes() * s.TilesX() * s.TilesY()
	if a.Low {
		if a.Plane < 0 || a.Plane >= s.LowPlanes() || a.X != 0 || a.Y != 0 {
			return 0, fmt.Errorf("film: no low tile at plane %d, %d, %d", a.Plane, a.X, a.Y)
		}
		return full + a.Plane, nil
	}
	if a.Plane < 0 || a.Plane >= s.FullPlanes() || a.X < 0 || a.X >= s.TilesX() || a.Y < 0 || a.Y >= s.TilesY() {
		return 0, fmt.Errorf("film: no tile at plane %d, %d, %d", a.Plane, a.X, a.Y)
	}
	return (a.Plane*s.TilesY()+a.Y)*s.TilesX() + a.X, nil
}

// address is the inverse of Index.
func (s Shape) address(index int) Address {
	perPlane := s.TilesX() * s.TilesY()
	if full := s.FullPlanes() * perPlane; index >= full {
		return Address{Low: true, Plane: index - full}
	}
	rest := index % perPlane
	return Address{Plane: index / perPlane, X: rest % s.TilesX(), Y: rest / s.TilesX()}
}

// region is what of a tile lies inside the image.
type region struct {
	side          int // of the tile
	width, height int // of the part that is inside
}

func (s Shape) region(a Address) region {
	if a.Low {
		return region{
			side:   LowSize,
			width:  (s.Width + s.CellWidth() - 1) / s.CellWidth(),
			height: (s.Height + s.CellHeight() - 1) / s.CellHeight(),
		}
	}
	return region{
		side:   TileSize,
		width:  min(TileSize, s.Width-a.X*TileSize),
		height: min(TileSize, s.Height-a.Y*TileSize),
	}
}

func (r region) values() int { return r.side * r.side * Channels }

// CellPixels is the number of pixels in a low-resolution cell, 0 for cells outside the image.
func (s Shape) CellPixels(column, row int) int {
	clip := func(index, size, limit int) int {
		return max(0, min(limit, (index+1)*size)-index*size)
	}
	return clip(column, s.CellWidth(), s.Width) * clip(row, s.CellHeight(), s.Height)
}

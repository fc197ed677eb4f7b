package bundle

import (
	"archive/tar"
	"context"
	"errors"
	"fmt"
	"io"
	"os"
	"path/filepath"
	"strings"
)

// Local is a set of files on this machine that make up one scene.
type Local struct {
	// Root is the deepest folder that holds all files and all folders that the scene names.
	Root string
	// Entry is the scene file's path below Root, with '/'.
	Entry string
	// Paths are all files below Root, with '/'. Entry is one of them.
	Paths []string
}

// NewLocal finds the root of a scene file and of what it names: files, and folders (with a separator
// at the end) in which it has files looked for, of which nothing else is taken. All paths must be
// absolute.
func NewLocal(scene string, files []string) (Local, error) {
	all := append([]string{scene}, files...)
	root := filepath.Dir(filepath.Clean(scene))
	for _, file := range all {
		if !filepath.IsAbs(file) {
			return Local{}, fmt.Errorf("%s: not an absolute path", file)
		}
		for !within(root, file) {
			root = filepath.Dir(root)
		}
	}
	local := Local{Root: root}
	seen := make(map[string]bool)
	for i, file := range all {
		if os.IsPathSeparator(file[len(file)-1]) {
			continue
		}
		relative, err := filepath.Rel(root, file)
		if err != nil {
			return Local{}, fmt.Errorf("%s: %w", file, err)
		}
		name := filepath.ToSlash(relative)
		if i == 0 {
			local.Entry = name
		}
		if !seen[name] {
			seen[name] = true
			local.Paths = append(local.Paths, name)
		}
	}
	return local, nil
}

func within(root, file string) bool {
	relative, err := filepath.Rel(root, file)
	return err == nil && relative != ".." && !strings.HasPrefix(relative, ".."+string(filepath.Separator))
}

// AddLocal stores files of this machine as a bundle.
func (l *Library) AddLocal(ctx context.Context, local Local) (Scene, error) {
	c := newCollector(l.blobs, l.limits)
	for _, name := range local.Paths {
		if err := addLocalFile(ctx, c, local.Root, name); err != nil {
			return Scene{}, err
		}
	}
	return c.finish(ctx)
}

func addLocalFile(ctx context.Context, c *collector, root, name string) error {
	file, err := os.Open(filepath.Join(root, filepath.FromSlash(name)))
	if err != nil {
		return err
	}
	defer file.Close()
	return c.add(ctx, name, file)
}

// WriteTar writes the files as a tar archive, for upload to a server.
func (l Local) WriteTar(w io.Writer) error {
	archive := tar.NewWriter(w)
	for _, name := range l.Paths {
		if err := writeTarFile(archive, l.Root, name); err != nil {
			return err
		}
	}
	return archive.Close()
}

func writeTarFile(archive *tar.Writer, root, name string) error {
	file, err := os.Open(filepath.Join(root, filepath.FromSlash(name)))
	if err != nil {
		return err
	}
	defer file.Close()
	info, err := file.Stat()
	if err != nil {
		return err
	}
	if !info.Mode().IsRegular() {
		return fmt.Errorf("%s: not a regular file", file.Name())
	}
	header := &tar.Header{Typeflag: tar.TypeReg, Name: name, Size: info.Size(), Mode: 0o644}
	if err := archive.WriteHeader(header); err != nil {
		return fmt.Errorf("%s: %w", file.Name(), err)
	}
	if _, err := io.Copy(archive, file); err != nil {
		if errors.Is(err, tar.ErrWriteTooLong) {
			return fmt.Errorf("%s: changed while it was read", file.Name())
		}
		return fmt.Errorf("%s: %w", file.Name(), err)
	}
	return nil
}

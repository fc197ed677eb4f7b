// Package tlsconf makes TLS configurations from files that may be replaced while a server runs, and
// certificates for trying TLS out. Only TLS 1.3 is spoken: every client of this decade knows it.
package tlsconf

import (
	"crypto/tls"
	"crypto/x509"
	"fmt"
	"os"
	"sync/atomic"
	"time"

	"metrofarm/services/internal/auth"
)

// Files of one server, in PEM.
type Files struct {
	// Certificate, with those that lead to its authority, and Key.
	Certificate, Key string
	// ClientCA signs the certificates of clients; empty: clients need none.
	ClientCA string
}

// Server is what a server presents and asks for. Methods may be called from several goroutines.
type Server struct {
	files   Files
	current atomic.Pointer[tls.Config]
}

// Open reads the files. Other users must not be able to read the key.
func Open(files Files) (*Server, error) {
	s := &Server{files: files}
	if err := s.Reload(); err != nil {
		return nil, err
	}
	return s, nil
}

// Files that Open was given.
func (s *Server) Files() []string {
	files := []string{s.files.Certificate, s.files.Key}
	if s.files.ClientCA != "" {
		files = append(files, s.files.ClientCA)
	}
	return files
}

// Reload reads the files again: connections made from then on see them. On an error, those of before
// stay.
func (s *Server) Reload() error {
	if err := auth.CheckPrivate(s.files.Key); err != nil {
		return fmt.Errorf("TLS key: %w", err)
	}
	pair, err := tls.LoadX509KeyPair(s.files.Certificate, s.files.Key)
	if err != nil {
		return fmt.Errorf("TLS certificate %s with key %s: %w", s.files.Certificate, s.files.Key, err)
	}
	if now := time.Now(); now.After(pair.Leaf.NotAfter) {
		return fmt.Errorf("TLS certificate %s: ended at %s", s.files.Certificate, pair.Leaf.NotAfter.Format(time.RFC3339))
	}
	config := &tls.Config{
		MinVersion: tls.VersionTLS13, Certificates: []tls.Certificate{pair}, NextProtos: []string{"h2", "http/1.1"},
	}
	if s.files.ClientCA != "" {
		if config.ClientCAs, err = readCA(s.files.ClientCA); err != nil {
			return err
		}
		config.ClientAuth = tls.RequireAndVerifyClientCert
	}
	s.current.Store(config)
	return nil
}

// Config asks for the files of the moment at each connection.
func (s *Server) Config() *tls.Config {
	return &tls.Config{
		MinVersion: tls.VersionTLS13, NextProtos: []string{"h2", "http/1.1"},
		GetConfigForClient: func(*tls.ClientHelloInfo) (*tls.Config, error) { return s.current.Load(), nil },
	}
}

// Client returns the configuration of a client that trusts the authorities of a file only.
func Client(ca string) (*tls.Config, error) {
	pool, err := readCA(ca)
	if err != nil {
		return nil, err
	}
	return &tls.Config{MinVersion: tls.VersionTLS13, RootCAs: pool}, nil
}

func readCA(path string) (*x509.CertPool, error) {
	content, err := os.ReadFile(path)
	if err != nil {
		return nil, fmt.Errorf("TLS authority: %w", err)
	}
	pool := x509.NewCertPool()
	if !pool.AppendCertsFromPEM(content) {
		return nil, fmt.Errorf("TLS authority %s: has no certificate in PEM", path)
	}
	return pool, nil
}
